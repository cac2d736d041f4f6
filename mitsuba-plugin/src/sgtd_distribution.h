#pragma once

#include <algorithm>
#include <cmath>

#include <mitsuba/core/frame.h>
#include <mitsuba/render/fwd.h>

#include "azimuth.h"
#include "sgtd_tables.h"

NAMESPACE_BEGIN(mitsuba)

/**
 * A distribution of the SGTD family at given roughness, with the methods of Mitsuba's
 * MicrofacetDistribution.
 *
 * Scalar variants call the Rust core, the others evaluate the same formulas in single precision on
 * the core's tables. All formulas are in stretched slopes: a normal m has the slope (x, y) =
 * (m.x/alpha_u, m.y/alpha_v) / m.z of radius rho, and a direction w becomes (alpha_u w.x, alpha_v
 * w.y, w.z). Its length does not matter, so c and s are its cosine and sine times any number.
 */
template <typename Float, typename Spectrum> class SgtdDistribution {
public:
    MI_IMPORT_TYPES()
    using Tables = SgtdTables<Float>;

    /// What `sample` returns.
    struct Sample {
        /// The normal that was drawn
        Normal3f m;
        /// Its density per solid angle; 0 if there is no valid sample
        Float pdf;
        /// D(m) / pdf
        Float d_over_pdf;
    };

    SgtdDistribution(const sgtd::host::Ndf &ndf, const Tables &tables, const Float &alpha_u,
                     const Float &alpha_v, bool sample_visible)
        : m_ndf(ndf), m_tables(tables), m_alpha_u(dr::maximum(alpha_u * tables.alpha_scale, 1e-4f)),
          m_alpha_v(dr::maximum(alpha_v * tables.alpha_scale, 1e-4f)),
          m_sample_visible(sample_visible) {}

    /**
     * D(m) per solid angle for the half vector m of `wi` and `wo`; 0 where D(m) cos(theta_m) <=
     * 1e-20, as in MicrofacetDistribution. A refraction gives wi and eta wo, or both negated if
     * their sum points down.
     *
     * The half vector is not given but formed here: rounded to single precision, its slope moves
     * thin rings and steep edges by more than D can bear.
     */
    Float eval(const Vector3f &wi, const Vector3f &wo) const {
        Float d, z;
        if constexpr (!dr::is_jit_v<Float>) {
            sgtd::host::Vec3 h = to_core(wi), w = to_core(wo);
            double square = 0.0;
            for (size_t i = 0; i < 3; ++i) {
                h[i] += w[i];
                square += h[i] * h[i];
            }
            double inv_length = 1.0 / std::sqrt(square);
            for (double &component : h)
                component *= inv_length;
            d = (Float)std::min(m_ndf.d(m_alpha_u, m_alpha_v, h), (double)GreatestD);
            z = (Float)h[2];
        } else {
            // Unnormalized: each rounding of a slope counts
            Vector3f h  = wi + wo;
            Float inv_h = dr::rcp(dr::maximum(h.z(), LeastCos));
            Float root  = m_tables.steep ? steep_sqrt_f(wi, wo)
                                         : m_tables.profile.sqrt_f(slope_square(h, inv_h));
            z           = h.z() * dr::rsqrt(dr::squared_norm(h));
            d           = dr::minimum(density(root, dr::square(dr::rcp(dr::maximum(z, LeastCos)))),
                                      GreatestD);
        }
        return dr::select(d * z > 1e-20f, d, 0.f);
    }

    /**
     * cos(theta) (1 + Lambda): the area of all facets that face `v`, seen from there.
     *
     * Finite where Lambda is infinite: with r = |(alpha_u v.x, alpha_v v.y)| and a = v.z / r,
     * Lambda = H(a)/a and the area is v.z + r H(a).
     */
    Float facing_area(const Vector3f &v) const {
        if constexpr (!dr::is_jit_v<Float>) {
            return (Float)(v.z() * (1.0 + m_ndf.lambda(m_alpha_u, m_alpha_v, to_core(v))));
        } else {
            Float r = dr::sqrt(
                dr::maximum(dr::square(m_alpha_u * v.x()) + dr::square(m_alpha_v * v.y()), 1e-20f));
            return dr::fmadd(r, masked_slope(v.z() / r), v.z());
        }
    }

    /// Masking of the facet `m` seen from `v`.
    Float smith_g1(const Vector3f &v, const Vector3f &m) const {
        return dr::select(faces(v, m), v.z() / facing_area(v), 0.f);
    }

    /// Masking and shadowing of the facet `m`, independent of each other or correlated by height.
    Float G(const Vector3f &wi, const Vector3f &wo, const Vector3f &m,
            bool height_correlated) const {
        Float area_i = facing_area(wi), area_o = facing_area(wo);
        Float result = height_correlated
                           ? wi.z() * wo.z() / dr::fmadd(area_i, wo.z(), wi.z() * (area_o - wo.z()))
                           : (wi.z() / area_i) * (wo.z() / area_o);
        return dr::select(faces(wi, m) && faces(wo, m), result, 0.f);
    }

    /// Density of the normals that `sample` draws, per solid angle.
    Float pdf(const Vector3f &wi, const Vector3f &m) const {
        if constexpr (!dr::is_jit_v<Float>) {
            return (Float)m_ndf.pdf(m_alpha_u, m_alpha_v, to_core(wi), to_core(m),
                                    m_sample_visible);
        } else {
            Float inv_z = dr::rcp(dr::maximum(m.z(), LeastCos)), y = slope_square(m, inv_z),
                  azimuthal;
            Row row;
            if (m_sample_visible) {
                View view(stretch(wi));
                row = row_of(view);
                Azimuth<Float> azimuth(view.c, view.s * dr::sqrt(dr::maximum(y, 1e-20f)));
                Vector3f w   = view.w;
                Float facing = dr::fmadd(w.x(), m.x() * inv_z / m_alpha_u,
                                         dr::fmadd(w.y(), m.y() * inv_z / m_alpha_v, w.z()));
                azimuthal    = dr::maximum(facing, 0.f) * azimuth.inv_sum / azimuth.mass;
            } else {
                row       = normal_row();
                azimuthal = dr::InvPi<Float>;
            }
            Float stretched = radial_pdf(row, y) * azimuthal;
            return dr::select(stretched > 0.f, stretched * solid_angle(inv_z), 0.f);
        }
    }

    /// Draws a normal: `u.x()` selects its slope, `u.y()` its azimuth.
    Sample sample(const Vector3f &wi, const Point2f &u) const {
        if constexpr (!dr::is_jit_v<Float>) {
            sgtd::host::NormalSample s =
                m_ndf.sample(m_alpha_u, m_alpha_v, to_core(wi), u.x(), u.y(), m_sample_visible);
            bool valid = s.pdf * s.d_over_pdf * s.m[2] > 1e-20;
            return { Normal3f((Float)s.m[0], (Float)s.m[1], (Float)s.m[2]),
                     valid ? (Float)s.pdf : 0.f, valid ? (Float)s.d_over_pdf : 0.f };
        } else {
            Float sin_phi, cos_phi, azimuthal, radial, y;
            if (m_sample_visible) {
                View view(stretch(wi));
                std::tie(y, radial) = sample_radius(row_of(view), u.x());
                Azimuth<Float> azimuth(view.c, view.s * dr::sqrt(dr::maximum(y, 1e-20f)));
                auto terms              = azimuth.solve(1.f - dr::abs(dr::fmsub(2.f, u.y(), 1.f)));
                auto [sin_rel, cos_rel] = azimuth.sincos(terms);
                sin_rel                 = dr::select(u.y() < .5f, -sin_rel, sin_rel);
                sin_phi                 = dr::fmadd(view.sin_phi, cos_rel, view.cos_phi * sin_rel);
                cos_phi                 = dr::fmsub(view.cos_phi, cos_rel, view.sin_phi * sin_rel);
                azimuthal               = terms.slope / azimuth.mass;
            } else {
                std::tie(y, radial)        = sample_radius(normal_row(), u.x());
                std::tie(sin_phi, cos_phi) = dr::sincos(dr::TwoPi<Float> * u.y());
                azimuthal                  = dr::InvPi<Float>;
            }

            Float rho = dr::sqrt(dr::maximum(y, 1e-20f));
            Vector3f m(m_alpha_u * rho * cos_phi, m_alpha_v * rho * sin_phi, 1.f);
            Float inv_z = dr::norm(m), stretched = radial * azimuthal,
                  root = m_tables.profile.sqrt_f(y), d = density(root, dr::square(inv_z));
            m *= dr::rcp(inv_z);
            Mask valid = stretched > 1e-36f && d > 1e-20f * inv_z;
            // f / stretched: inside a ring both are so small that the derivative, which has the
            // square of the divisor in it, would overflow
            Float ratio = dr::square(root / dr::sqrt(dr::maximum(stretched, 1e-36f)));
            return { Normal3f(m), dr::select(valid, stretched * solid_angle(inv_z), 0.f),
                     dr::select(valid, m_tables.factor * ratio * inv_z, 0.f) };
        }
    }

private:
    /// Least cosine of a normal that is divided by: the square of its inverse is finite
    static constexpr float LeastCos = 1e-18f;
    /// Greater values of D are cut off, so that products with them are finite
    static constexpr float GreatestD = 1e30f;

    static sgtd::host::Vec3 to_core(const Vector3f &v) {
        return { (double)dr::slice(v.x()), (double)dr::slice(v.y()), (double)dr::slice(v.z()) };
    }

    /// Are `v` and the normal of the surface on the same side of the facet `m`?
    static Mask faces(const Vector3f &v, const Vector3f &m) {
        return dr::dot(v, m) * Frame3f::cos_theta(v) > 0.f;
    }

    // ------------------------------------------------------------------
    //  Normal distribution
    // ------------------------------------------------------------------

    /// rho squared
    Float slope_square(const Vector3f &m, const Float &inv_z) const {
        return dr::square(m.x() * inv_z / m_alpha_u) + dr::square(m.y() * inv_z / m_alpha_v);
    }

    /// The square root of f at the half vector of two directions, in double precision.
    Float steep_sqrt_f(const Vector3f &wi, const Vector3f &wo) const {
        using Double = typename Tables::Double;
        Double inv_z = dr::rcp(dr::maximum(Double(wi.z()) + Double(wo.z()), (double)LeastCos)),
               x     = (Double(wi.x()) + Double(wo.x())) * inv_z / Double(m_alpha_u),
               y     = (Double(wi.y()) + Double(wo.y())) * inv_z / Double(m_alpha_v);
        return Float(m_tables.precise.sqrt_f(dr::fmadd(x, x, dr::square(y))));
    }

    /// d(slope area) / d(solid angle), stretched: 1 / (alpha_u alpha_v cos^3)
    Float solid_angle(const Float &inv_z) const {
        return inv_z * dr::square(inv_z) / (m_alpha_u * m_alpha_v);
    }

    /// A f / (pi alpha_u alpha_v cos^4), squared at the end: f may underflow, 1/cos^4 overflow.
    Float density(const Float &sqrt_f, const Float &inv_z2) const {
        return m_tables.factor / (m_alpha_u * m_alpha_v) * dr::square(sqrt_f * inv_z2);
    }

    // ------------------------------------------------------------------
    //  Masking
    // ------------------------------------------------------------------

    /**
     * H(a), where Lambda = H(a)/a: the cubic of a cell in the distance from its left end.
     *
     * The exponent of `a` selects an entry, which holds the octave's first cell and the shift that
     * makes cell numbers of mantissas.
     */
    Float masked_slope(const Float &a) const {
        constexpr uint32_t MantissaBits = 23, Mantissa = (1u << MantissaBits) - 1u;
        auto bits_of = [](const Float &x) { return dr::reinterpret_array<UInt32>(dr::detach(x)); };
        // Without the sign: directions below the horizon are masked later
        UInt32 bits  = bits_of(dr::abs(a)),
               entry = bits_of(dr::gather<Float>(m_tables.lambda, bits >> MantissaBits)),
               shift = entry & 31u,
               cell  = (entry >> 5u) + ((bits & Mantissa) >> shift) + Tables::Entries / 4;
        Float d      = a - dr::reinterpret_array<Float>((bits >> shift) << shift);
        Vector4f c   = dr::gather<Vector4f>(m_tables.lambda, cell);
        return dr::maximum(dr::fmadd(d, dr::fmadd(d, dr::fmadd(d, c.w(), c.z()), c.y()), c.x()),
                           0.f);
    }

    // ------------------------------------------------------------------
    //  Sampling: radius
    // ------------------------------------------------------------------

    /// A stretched direction.
    struct View {
        Vector3f w;
        Float c, s, sin_phi, cos_phi;

        explicit View(const Vector3f &w_) : w(w_), c(w_.z()) {
            Float s2    = dr::square(w.x()) + dr::square(w.y());
            Mask tilted = s2 > 1e-20f;
            s           = dr::sqrt(dr::maximum(s2, 1e-20f));
            Float inv_s = dr::rcp(s);
            sin_phi     = dr::select(tilted, w.y() * inv_s, 0.f);
            cos_phi     = dr::select(tilted, w.x() * inv_s, 1.f);
        }
    };

    Vector3f stretch(const Vector3f &w) const {
        return Vector3f(m_alpha_u * w.x(), m_alpha_v * w.y(), w.z());
    }

    /// Linear mixture of the rows `index` and `index + 1` of the visible-normal table.
    struct Row {
        UInt32 index;
        /// Weight of the first of the two
        Float weight;
        /// Is there no second one?
        bool alone = false;
    };

    /**
     * Rows are spaced evenly in c / (c + s b).
     *
     * The distance from the last one is what is computed: far out in the tail the row before it
     * outweighs the last one even at a weight of 1e-4, which a difference from 1 would garble.
     */
    Row row_of(const View &view) const {
        Float sb = view.s * m_tables.scale, c = dr::maximum(view.c, 0.f),
              r     = sb / dr::maximum(c + sb, 1e-18f) * (float)(Tables::Rows - 1);
        UInt32 back = dr::minimum(UInt32(dr::detach(r)), Tables::Rows - 2);
        return { (Tables::Rows - 2) - back, r - Float(back) };
    }

    /// The one row of a table without visible normals: the distribution of D cos.
    static Row normal_row() { return { UInt32(0), Float(1.f), true }; }

    static Float mix(const Row &row, const Float &first, const Float &second) {
        return row.alone ? first : dr::fmadd(row.weight, first - second, second);
    }

    /// As many values as one load fetches: eight times a load costs far less than eight gathers.
    using Block = dr::Array<Float, Tables::Block>;

    /// Block `k` of the knots; 0 is every eighth knot.
    Block knot_block(const UInt32 &k) const { return dr::gather<Block>(m_tables.visible, k); }

    /// Block `k` of the masses C above the knots; 0 is that of every eighth knot.
    Block mass_block(const Row &row, const UInt32 &k) const {
        constexpr uint32_t First = Tables::List / Tables::Block,
                           Next  = Tables::RowSize / Tables::Block;
        UInt32 index             = row.index * Next + k + First;
        Block first              = dr::gather<Block>(m_tables.visible, index);
        if (!row.alone) {
            Block second = dr::gather<Block>(m_tables.visible, index + Next);
            for (size_t i = 0; i < Tables::Block; ++i)
                first[i] = mix(row, first[i], second[i]);
        }
        return dr::detach(first);
    }

    /// Cell of a monotone rational-quadratic spline (Gregory & Delbourgo 1982): mass over y =
    /// rho^2.
    struct Cell {
        /// Left knot, width; mass below the knot, above it, in the cell; -dC/dy at both ends
        Float y, width, below, above, mass, g0, g1;

        /// Density at the fraction tau of the cell
        Float density(const Float &tau) const {
            Float slope = mass / width, inv = width / dr::maximum(mass, 1e-30f), d0 = g0 * inv,
                  d1 = g1 * inv, rest = tau * (1.f - tau);
            Float top  = dr::fmadd(d1, dr::square(tau),
                                   dr::fmadd(2.f, rest, d0 * dr::square(1.f - tau))),
                  base = dr::fmadd(d0 + d1 - 2.f, rest, 1.f);
            return dr::select(mass > 0.f, slope * top / dr::square(base), 0.f);
        }

        /// The fraction tau of the cell below which the share q of its mass lies
        Float invert(const Float &q) const {
            Float inv = width / dr::maximum(mass, 1e-30f), d0 = g0 * inv, d1 = g1 * inv,
                  k = d0 + d1 - 2.f, b = dr::fnmadd(q, k, d0),
                  root = dr::sqrt(dr::maximum(dr::fmadd(b, b, 4.f * q * (1.f - b)), 1e-30f));
            return dr::clip(2.f * q / dr::maximum(b + root, 1e-30f), 0.f, 1.f);
        }
    };

    Cell cell_at(const Row &row, const UInt32 &j) const {
        // Two rows (a, b), each at both ends of the cell
        constexpr uint32_t Next = Tables::RowSize / 2;
        UInt32 k                = row.index * Next + j + Tables::List;
        auto pair               = [&](const UInt32 &index) {
            return dr::gather<Vector2f>(m_tables.visible, index);
        };
        Vector2f a0 = pair(k), a1 = pair(k + 1u), b0 = row.alone ? a0 : pair(k + Next),
                 b1 = row.alone ? a1 : pair(k + Next + 1u);
        Cell cell;
        cell.y     = dr::gather<Float>(m_tables.visible, j + Tables::Block);
        cell.width = dr::gather<Float>(m_tables.visible, j + (Tables::Block + 1)) - cell.y;
        cell.above = mix(row, a0.x(), b0.x());
        // Differences within a row are exact, and may be far less than what they are taken from
        cell.below = mix(row, 1.f - a0.x(), 1.f - b0.x());
        cell.mass  = mix(row, a0.x() - a1.x(), b0.x() - b1.x());
        cell.g0    = mix(row, a0.y(), b0.y());
        cell.g1    = mix(row, a1.y(), b1.y());
        return cell;
    }

    /// The last cell whose left knot `holds`, which is taken for granted at the first of a block.
    template <typename Blocks, typename Holds>
    static UInt32 find_cell(const Blocks &block, const Holds &holds) {
        auto count = [&](const Block &values) {
            UInt32 n = 0u;
            for (size_t i = 1; i < Tables::Block; ++i)
                n += dr::select(holds(values[i]), UInt32(1u), UInt32(0u));
            return n;
        };
        UInt32 k = count(block(UInt32(0u)));
        return k * Tables::Block + count(block(k + 1u));
    }

    /// The last cell: normals so steep that their reflection is below the horizon. Never drawn.
    static constexpr uint32_t LostCell = Tables::Cells - 1;

    /// Draws y = rho^2; returns it with its density, which is 0 if the sample is lost.
    std::pair<Float, Float> sample_radius(const Row &row, const Float &u) const {
        Float target = 1.f - u;
        UInt32 j     = find_cell([&](const UInt32 &k) { return mass_block(row, k); },
                             [&](const Float &mass) { return mass >= dr::detach(target); });
        Mask lost    = j == LostCell;
        Cell cell    = cell_at(row, dr::minimum(j, LostCell - 1));
        // Mass of the cell below the target, counted from the nearer end of the distribution
        Float part = dr::select(u < .5f, u - cell.below, cell.above - target),
              q = dr::clip(part / dr::maximum(cell.mass, 1e-30f), 0.f, 1.f), tau = cell.invert(q);
        return { dr::fmadd(tau, cell.width, cell.y), dr::select(lost, 0.f, cell.density(tau)) };
    }

    /// Density of y under `sample_radius`.
    Float radial_pdf(const Row &row, const Float &y) const {
        UInt32 j  = find_cell([&](const UInt32 &k) { return knot_block(k); },
                             [&](const Float &knot) { return knot <= dr::detach(y); });
        Cell cell = cell_at(row, dr::minimum(j, LostCell - 1));
        Float tau = dr::clip((y - cell.y) / cell.width, 0.f, 1.f);
        return dr::select(j == LostCell, 0.f, cell.density(tau));
    }

private:
    const sgtd::host::Ndf &m_ndf;
    const Tables &m_tables;
    Float m_alpha_u, m_alpha_v;
    bool m_sample_visible;
};

NAMESPACE_END(mitsuba)
