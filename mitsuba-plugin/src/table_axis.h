#pragma once

#include <utility>

#include <mitsuba/core/fwd.h>

NAMESPACE_BEGIN(mitsuba)

/// The cell of a coordinate in [0, 1] on an axis of `count` nodes, and the place in it.
template <typename Float, typename UInt32>
std::pair<UInt32, Float> locate_cell(const Float &x, const UInt32 &count) {
    Float scaled = dr::clip(x, 0.f, 1.f) * Float(count - 1u);
    UInt32 cell  = dr::minimum(UInt32(dr::detach(scaled)), count - 2u);
    return { cell, scaled - Float(cell) };
}

NAMESPACE_END(mitsuba)
