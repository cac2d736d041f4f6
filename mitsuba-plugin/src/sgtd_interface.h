#pragma once

#include <memory>
#include <utility>

#include <mitsuba/core/fwd.h>
#include <mitsuba/core/logger.h>
#include <mitsuba/render/fwd.h>

#include "bridge.h"
#include "table_axis.h"

NAMESPACE_BEGIN(mitsuba)

/**
 * What a rough interface between two media reflects or transmits of light from above, for one pair
 * of roughnesses and one index. `rust-core/src/scattering/interface_table.rs` documents the table.
 * Scalar and JIT variants run the same code on it.
 */
template <typename Float_> struct SgtdInterface {
    using Float       = Float_;
    using UInt32      = dr::uint32_array_t<Float>;
    using Mask        = dr::mask_t<Float>;
    using Cubic       = dr::Array<Float, 4>;
    using FloatBuffer = DynamicBuffer<Float>;

    static constexpr uint32_t Octaves = sgtd::host::InterfaceOctaves,
                              Cells   = sgtd::host::InterfaceCells;

    /// Cosine of total reflection, and the inverse widths below and above it
    Float critical, inv_below, inv_above;
    /// sqrt(alpha_v / alpha_u)
    Float root_ratio;
    /// The averages over diffuse light that `sgtd::host::Interface` has
    Float average, internal_reflectance, facet_reflectance;
    /// Azimuths: opaque, and read only if there are two roughnesses
    UInt32 columns;
    FloatBuffer table;
    /// Held so that equal materials share it
    std::shared_ptr<const sgtd::host::Interface> source;

    static SgtdInterface load(std::shared_ptr<const sgtd::host::Interface> from, double alpha_u,
                              double alpha_v) {
        const sgtd::host::Interface &host = *from;
        if (host.table.size() !=
            (size_t)4 * Octaves * Cells * (host.critical > 0.0 ? 4 : 2) * host.columns)
            Throw("sgtd: the table of a rough interface does not have the layout that this plugin "
                  "was built for; rebuild the package.");
        using Scalar = dr::scalar_t<Float>;
        SgtdInterface result;
        // An index near 0 reflects all light: its upper side has no width
        result.critical             = (Scalar)host.critical;
        result.inv_below            = (Scalar)(1.0 / std::max(host.critical, 1e-9));
        result.inv_above            = (Scalar)(1.0 / std::max(1.0 - host.critical, 1e-9));
        result.root_ratio           = (Scalar)std::sqrt(alpha_v / alpha_u);
        result.average              = (Scalar)host.average;
        result.internal_reflectance = (Scalar)host.internal_reflectance;
        result.facet_reflectance    = (Scalar)host.facet_reflectance;
        result.columns              = host.columns;
        result.table                = dr::load<FloatBuffer>(host.table.data(), host.table.size());
        if constexpr (dr::is_jit_v<Float>)
            dr::make_opaque(result.critical, result.inv_below, result.inv_above, result.root_ratio,
                            result.average, result.internal_reflectance, result.facet_reflectance,
                            result.columns, result.table);
        result.source = std::move(from);
        return result;
    }

    /// The reflectance or transmittance of a direction, w.z > 0; `anisotropic` if the table has
    /// azimuths.
    template <typename Vector>
    Float at(const Vector &w, bool anisotropic, const Mask &active) const {
        auto [cell, t] = locate(w.z());
        auto read      = [&](const UInt32 &index) {
            Cubic c = dr::gather<Cubic>(table, index, active);
            return dr::fmadd(t, dr::fmadd(t, dr::fmadd(t, c[3], c[2]), c[1]), c[0]);
        };
        if (!anisotropic)
            return read(cell);
        Float x = dr::abs(w.x()), y = dr::abs(w.y()) * root_ratio, sum = x + y;
        auto [column, s] = locate_cell(
            dr::select(sum > 1e-12f, Float(y / dr::maximum(sum, 1e-12f)), Float(0.f)), columns);
        UInt32 index = dr::fmadd(cell, columns, column);
        return dr::lerp(read(index), read(index + 1u), s);
    }

private:
    /// The cell of a cosine, and the place in it: by the distance from the horizon, the normal or
    /// the cosine of total reflection, in octaves.
    std::pair<UInt32, Float> locate(const Float &mu) const {
        // Single precision, whatever the variant has: bits select a cell
        using Single            = dr::float32_array_t<Float>;
        constexpr uint32_t Bits = 23, Log = 3, Shift = Bits - Log;
        static_assert(Cells == 1u << Log);

        Mask below     = mu < critical;
        Float low      = dr::select(below, mu, mu - critical),
              high     = dr::select(below, critical - mu, 1.f - mu);
        Mask upper     = high < low;
        Float distance = dr::clip(dr::minimum(low, high) * dr::select(below, inv_below, inv_above),
                                  std::ldexp(1.f, -int(Octaves) - 1), .49999997f);
        UInt32 bits    = dr::reinterpret_array<UInt32>(Single(dr::detach(distance))),
               cell    = bits >> Shift;
        Float start(dr::reinterpret_array<Single>(cell << Shift)),
            per_cell(dr::reinterpret_array<Single>((254u + Log - (bits >> Bits)) << Bits));
        UInt32 first =
            dr::select(below, UInt32(2), UInt32(0)) + dr::select(upper, UInt32(1), UInt32(0));
        return { cell - ((126u - Octaves) << Log) + first * (Octaves * Cells),
                 (distance - start) * per_cell };
    }

public:
    DRJIT_STRUCT(SgtdInterface, critical, inv_below, inv_above, root_ratio, average,
                 internal_reflectance, facet_reflectance, columns, table)
};

NAMESPACE_END(mitsuba)
