#pragma once

namespace sgtd {

/// Throws unless the Mitsuba library in this process is the release that this plugin was built
/// against.
void check_mitsuba_version();

} // namespace sgtd
