#include "mitsuba_version.h"

#include <dlfcn.h>
#include <mitsuba/mitsuba.h>

#include <stdexcept>
#include <string>

namespace sgtd {

namespace {

/// Version of the loaded library, or an empty string if it cannot be told.
std::string loaded_version() {
    // Looked up by name: a release that lacks the function must give an error, not fail to bind and
    // end the process. The name is that of `std::string mitsuba::util::info_build(int)`, whose
    // result starts "Mitsuba version 3.9.1 (".
    void *library = dlopen("libmitsuba.so", RTLD_LAZY | RTLD_NOLOAD);
    if (!library)
        return {};
#if _GLIBCXX_USE_CXX11_ABI
    const char *name = "_ZN7mitsuba4util10info_buildB5cxx11Ei";
#else
    const char *name = "_ZN7mitsuba4util10info_buildEi";
#endif
    auto info_build  = (std::string (*)(int))dlsym(library, name);
    std::string info = info_build ? info_build(1) : std::string();
    dlclose(library);

    const std::string prefix = "Mitsuba version ";
    if (info.compare(0, prefix.size(), prefix) != 0)
        return {};
    return info.substr(prefix.size(), info.find(' ', prefix.size()) - prefix.size());
}

} // namespace

void check_mitsuba_version() {
    std::string version = loaded_version();
    if (version != MI_VERSION)
        throw std::runtime_error(
            "sgtd: this plugin was built for Mitsuba " MI_VERSION ", but " +
            (version.empty() ? std::string("another release") : "Mitsuba " + version) +
            " is loaded. Reinstall the sgtd package together with mitsuba==" MI_VERSION ".");
}

} // namespace sgtd
