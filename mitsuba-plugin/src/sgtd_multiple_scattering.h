#pragma once

#include <cmath>
#include <memory>
#include <utility>

#include <mitsuba/core/fwd.h>
#include <mitsuba/core/logger.h>
#include <mitsuba/render/fresnel.h>
#include <mitsuba/render/fwd.h>

#include "bridge.h"
#include "table_axis.h"

NAMESPACE_BEGIN(mitsuba)

/**
 * What single scattering loses, and the lobe that returns it: with E the albedo of single
 * scattering for a perfect mirror,
 *
 *     f_ms = F_ms (1 - E(w_i)) (1 - E(w_o)) / (pi (1 - E_avg))
 *
 * (Kelemen & Szirmay-Kalos 2001). `rust-core/src/scattering/albedo_table.rs` documents the table,
 * and why its coordinates are what they are. Scalar and JIT variants run the same code on it.
 */
template <typename Float_> struct SgtdMultipleScattering {
    using Float       = Float_;
    using UInt32      = dr::uint32_array_t<Float>;
    using Mask        = dr::mask_t<Float>;
    using Packet      = dr::Array<Float, sgtd::host::MissingEnergyPacket>;
    using FloatBuffer = DynamicBuffer<Float>;

    /// Length of the list of averages
    static constexpr uint32_t Average = sgtd::host::AverageNodes;

    /// Is the table for one pair of roughnesses, or for every isotropic one?
    bool fixed = false;
    /// Median slope; exponents of the view's coordinate at the horizon and along the normal
    Float slope, power, end;
    /// Of isotropic tables: exponent of the roughness' coordinate, and its inverse at the greatest
    /// roughness; that roughness inverted, and the inverse of log2(least / greatest roughness)
    Float spread, inv_greatest, inv_greatest_alpha, inv_least_log;
    /// Of tables for one pair: the pair, log2(1 - E_avg), derivatives by the pair's logarithms
    Float alpha_u, alpha_v, average, average_u, average_v;
    /// Nodes of the grid over the view, and over roughness or azimuth: opaque, so that shapes whose
    /// tables differ in size share their kernels
    UInt32 views, columns;
    FloatBuffer table;
    /// Held so that equal materials share it
    std::shared_ptr<const sgtd::host::MissingEnergy> source;

    /// For every isotropic roughness.
    static SgtdMultipleScattering load(std::shared_ptr<const sgtd::host::MissingEnergy> missing) {
        return load(std::move(missing), false, 1.0, 1.0);
    }

    /// For one pair of roughnesses.
    static SgtdMultipleScattering load(std::shared_ptr<const sgtd::host::MissingEnergy> missing,
                                       double alpha_u, double alpha_v) {
        return load(std::move(missing), true, alpha_u, alpha_v);
    }

    /// What both directions share: the roughness, and 1 - E_avg.
    struct Surface {
        Float alpha_u, alpha_v, average_missing_energy;
    };

    Surface surface(const Float &u, const Float &v) const {
        if (fixed)
            return { u, v,
                     dr::exp2(dr::fmadd(average_u, dr::log(u / alpha_u),
                                        dr::fmadd(average_v, dr::log(v / alpha_v), average))) };
        // Two textures: the isotropic roughness that is closest for slopes across the view
        Float alpha    = .5f * (u + v);
        auto [cell, t] = locate_cell(1.f - dr::log2(alpha * inv_greatest_alpha) * inv_least_log,
                                     UInt32(Average));
        UInt32 k       = 4u * views * columns + cell;
        Float low = dr::gather<Float>(table, k), high = dr::gather<Float>(table, k + 1u);
        return { alpha, alpha, dr::exp2(dr::fmadd(t, high - low, low)) };
    }

    /// 1 - E(w), w.z > 0.
    template <typename Vector> Float missing_energy(const Surface &s, const Vector &w) const {
        Float sin2 = dr::maximum(dr::square(w.x()) + dr::square(w.y()), 1e-18f),
              sin = dr::sqrt(sin2), along = s.alpha_u;
        if (fixed) {
            Float square = dr::square(s.alpha_u * w.x()) + dr::square(s.alpha_v * w.y());
            along        = dr::sqrt(dr::maximum(square / sin2, 1e-18f));
        }
        Float ratio = w.z() / dr::fmadd(sin, half(along), w.z()),
              near  = dr::exp2(power * dr::log2(dr::clip(ratio, 1e-30f, 1.f))),
              v     = 1.f - dr::exp2(end * dr::log2(dr::maximum(1.f - near, 1e-7f)));
        Float root  = fixed ? read_pair(s, w, v)
                            : read_isotropic(v, dr::exp2(spread * dr::log2(relative(s.alpha_u))));
        return dr::square(dr::clip(root, 0.f, 1.f));
    }

    /**
     * Draws a direction for the lobe, by u and by two more random numbers: half of them in
     * proportion to the cosine, half to cos / (c^2 + cos^2)^2, which follows the missing energy of
     * low roughness towards the horizon.
     */
    template <typename Point> auto sample(const Surface &s, const Float &u, const Point &p) const {
        using Vector3 = Vector<Float, 3>;
        Float c2 = dr::square(lobe_width(s)), y = p.x() / (1.f + c2),
              square            = dr::select(u < .5f, p.x(), dr::minimum(c2 * y / (1.f - y), 1.f)),
              sine              = dr::sqrt(1.f - square);
        auto [sin_phi, cos_phi] = dr::sincos(dr::TwoPi<Float> * p.y());
        return Vector3(sine * cos_phi, sine * sin_phi, dr::sqrt(square));
    }

    /// Its density per solid angle.
    template <typename Vector> Float pdf(const Surface &s, const Vector &w) const {
        Float c2 = dr::square(lobe_width(s));
        return w.z() * dr::InvPi<Float> *
               dr::fmadd(.5f * (1.f + c2), c2 / dr::square(dr::fmadd(w.z(), w.z(), c2)), .5f);
    }

    /**
     * F_ms: what is left of light that facets with the average Fresnel reflectance F reflect twice
     * or more.
     *
     * The series of reflections, of which the share E_avg leaves after each one: F^2 E_avg / (1 - F
     * (1 - E_avg)) (Kulla & Conty 2017, with the square of Hill 2018, for two reflections at
     * least).
     */
    template <typename Spectrum>
    static Spectrum tint(const Float &average_missing_energy, const Spectrum &F) {
        Float leave = dr::maximum(1.f - average_missing_energy, 1e-6f);
        return dr::square(F) * leave / dr::maximum(1.f - F + F * leave, 1e-6f);
    }

    /// The lobe itself times the cosine and by F_ms: `lost` is what `missing_energy` has for the
    /// view.
    template <typename Vector>
    Float lobe(const Surface &s, const Float &lost, const Vector &wo) const {
        return dr::InvPi<Float> * wo.z() * lost * missing_energy(s, wo) /
               dr::maximum(s.average_missing_energy, 1e-30f);
    }

    /**
     * F_avg = 2 * integral of F(mu) mu of a conductor, by the four-point Gauss rule for the weight
     * mu.
     *
     * Where k is near 0 and eta below 1, which no metal is at visible wavelengths, F has a bend
     * that the rule does not see.
     */
    template <typename Spectrum> static Spectrum average_fresnel(const dr::Complex<Spectrum> &eta) {
        constexpr float Nodes[4]   = { 0.139759864f, 0.416409568f, 0.723156986f, 0.942895804f },
                        Weights[4] = { 0.0623619419f, 0.259695095f, 0.406929136f, 0.271013827f };
        Spectrum sum(0.f);
        for (size_t i = 0; i < 4; ++i)
            sum += Weights[i] * fresnel_conductor(Spectrum(Nodes[i]), eta);
        return dr::minimum(sum, 1.f);
    }

private:
    static SgtdMultipleScattering load(std::shared_ptr<const sgtd::host::MissingEnergy> source,
                                       bool fixed, double alpha_u, double alpha_v) {
        const sgtd::host::MissingEnergy &missing = *source;
        if (missing.table.size() !=
            (size_t)sgtd::host::MissingEnergyPacket * missing.views * missing.columns +
                (fixed ? 0u : Average))
            Throw("sgtd: the table of missing energy does not have the layout that this plugin was "
                  "built "
                  "for; rebuild the package.");
        SgtdMultipleScattering result;
        result.fixed              = fixed;
        result.slope              = (float)missing.slope;
        result.power              = (float)missing.power;
        result.end                = (float)missing.end;
        result.spread             = (float)missing.spread;
        result.inv_greatest       = (float)(1.0 / missing.greatest);
        result.inv_greatest_alpha = (float)(1.0 / missing.greatest_alpha);
        result.inv_least_log =
            (float)(1.0 / std::log2(missing.least_alpha / missing.greatest_alpha));
        result.alpha_u   = (float)alpha_u;
        result.alpha_v   = (float)alpha_v;
        result.average   = (float)missing.average_log;
        result.average_u = (float)missing.average_u;
        result.average_v = (float)missing.average_v;
        result.views     = missing.views;
        result.columns   = missing.columns;
        result.table     = dr::load<FloatBuffer>(missing.table.data(), missing.table.size());
        if constexpr (dr::is_jit_v<Float>)
            dr::make_opaque(result.slope, result.power, result.end, result.spread,
                            result.inv_greatest, result.inv_greatest_alpha, result.inv_least_log,
                            result.alpha_u, result.alpha_v, result.average, result.average_u,
                            result.average_v, result.views, result.columns, result.table);
        result.source = std::move(source);
        return result;
    }

    /// The cosine at which missing energy ends
    Float lobe_width(const Surface &s) const {
        return dr::maximum(compressed(.5f * (s.alpha_u + s.alpha_v)), 1e-4f);
    }

    /// c: the tangent of the elevation around which missing energy changes, for low roughness and
    /// for high
    Float half(const Float &along) const {
        Float x = along * slope;
        return x / dr::fmadd(x, x, 1.f);
    }

    Float compressed(const Float &alpha) const {
        Float x = alpha * slope;
        return x / (1.f + x);
    }

    /// alpha x / (1 + alpha x), 1 at the greatest roughness
    Float relative(const Float &alpha) const {
        return dr::clip(compressed(alpha) * inv_greatest, 1e-12f, 1.f);
    }

    Packet packet(const UInt32 &index) const { return dr::gather<Packet>(table, index); }

    /// Bicubic Hermite polynomial.
    Float read_isotropic(const Float &v, const Float &w) const {
        auto [i, s]  = locate_cell(v, views);
        auto [j, t]  = locate_cell(w, columns);
        UInt32 index = i * columns + j;
        // Polynomials for value and derivative at both ends
        auto at = [](const Float &x) {
            Float rest = 1.f - x;
            return Packet(dr::square(rest) * dr::fmadd(2.f, x, 1.f), x * dr::square(rest),
                          dr::square(x) * dr::fmadd(2.f, rest, 1.f), -dr::square(x) * rest);
        };
        Packet p = at(s), q = at(t);
        auto term = [&](const UInt32 &k, const Float &value_v, const Float &slope_v,
                        const Float &value_w, const Float &slope_w) {
            Packet f = packet(k);
            return dr::fmadd(value_v, dr::fmadd(value_w, f[0], slope_w * f[2]),
                             slope_v * dr::fmadd(value_w, f[1], slope_w * f[3]));
        };
        return term(index, p[0], p[1], q[0], q[1]) + term(index + 1u, p[0], p[1], q[2], q[3]) +
               term(index + columns, p[2], p[3], q[0], q[1]) +
               term(index + columns + 1u, p[2], p[3], q[2], q[3]);
    }

    /// Bilinear interpolation of value and derivatives by the roughness.
    template <typename Vector>
    Float read_pair(const Surface &surface, const Vector &w, const Float &v) const {
        // The square root of the roughness has no effect where it is not known: along the normal
        Float x = dr::sqrt(surface.alpha_u) * dr::abs(w.x()),
              y = dr::sqrt(surface.alpha_v) * dr::abs(w.y()), sum = x + y;
        Float azimuth = dr::select(sum > 1e-12f, y / dr::maximum(sum, 1e-12f), 0.f);
        auto [i, s]   = locate_cell(v, views);
        auto [j, t]   = locate_cell(azimuth, columns);
        UInt32 k      = i * columns + j;
        Packet low    = dr::lerp(packet(k), packet(k + 1u), t),
               high   = dr::lerp(packet(k + columns), packet(k + columns + 1u), t),
               f      = dr::lerp(low, high, s);
        return dr::fmadd(f[1], dr::log(surface.alpha_u / alpha_u),
                         dr::fmadd(f[2], dr::log(surface.alpha_v / alpha_v), f[0]));
    }

public:
    DRJIT_STRUCT(SgtdMultipleScattering, slope, power, end, spread, inv_greatest,
                 inv_greatest_alpha, inv_least_log, alpha_u, alpha_v, average, average_u, average_v,
                 views, columns, table)
};

NAMESPACE_END(mitsuba)
