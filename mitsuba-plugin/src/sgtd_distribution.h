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

    using Normals = sgtd::host::Normals;

    /// What `sample` returns.
    struct Sample {
        /// The normal that was drawn
        Normal3f m;
        /// Its density per solid angle; 0 if there is no valid sample
        Float pdf;
        /// D(m) / pdf
        Float d_over_pdf;
    };

    /// What a reflection needs of a pair of directions, both above the horizon.
    struct Reflected {
        /// D of their half vector, masking, and density of the half vector per solid angle
        Float d, g, pdf;
    };

    /// A normal for a reflection.
    struct ReflectionSample : Sample {
        /// Masking of the reflected direction, which has to be above the horizon
        Float g;
    };

    /// `one_roughness`: are both the same for certain?
    SgtdDistribution(const sgtd::host::Ndf &ndf, const Tables &tables, const Float &alpha_u,
                     const Float &alpha_v, Normals normals, bool one_roughness)
        : m_ndf(ndf), m_tables(tables), m_given_u(alpha_u), m_given_v(alpha_v),
          m_alpha_u(dr::maximum(alpha_u * tables.alpha_scale, LeastAlpha)),
          m_alpha_v(dr::maximum(alpha_v * tables.alpha_scale, LeastAlpha)),
          m_inv_alpha_u(dr::rcp(m_alpha_u)), m_inv_alpha_v(dr::rcp(m_alpha_v)), m_normals(normals),
          m_one_roughness(one_roughness) {}

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
        if constexpr (Tables::Single) {
            if (!by_core()) {
                Facet facet(*this, wi + wo);
                Float root =
                    m_tables.steep ? steep_sqrt_f(wi, wo) : m_tables.sqrt_f(facet.square());
                z = facet.cos;
                d = dr::minimum(density(root, dr::square(facet.sec)), GreatestD);
                return dr::select(d * z > 1e-20f, d, 0.f);
            }
        }
        sgtd::host::Vec3 h = to_core(wi), w = to_core(wo);
        for (size_t i = 0; i < 3; ++i)
            h[i] += w[i];
        h = unit(h);
        d = (Float)std::min(m_ndf.d(number(m_alpha_u), number(m_alpha_v), h), (double)GreatestD);
        z = (Float)h[2];
        return dr::select(d * z > 1e-20f, d, 0.f);
    }

    /**
     * cos(theta) (1 + Lambda): the area of all facets that face `v`, seen from there.
     *
     * Finite where Lambda is infinite: with r = |(alpha_u v.x, alpha_v v.y)| and a = v.z / r,
     * Lambda = H(a)/a and the area is v.z + r H(a).
     */
    Float projected_area(const Vector3f &v) const {
        if constexpr (Tables::Single)
            if (!by_core())
                return projected_area(Stretched(*this, v));
        return (Float)m_ndf.projected_area(number(m_alpha_u), number(m_alpha_v), to_core(v));
    }

    /// Masking of the facet `m` seen from `v`.
    Float smith_g1(const Vector3f &v, const Vector3f &m) const {
        return dr::select(faces(v, m), v.z() / projected_area(v), 0.f);
    }

    /// Masking and shadowing of the facet `m`, independent of each other or correlated by height.
    Float G(const Vector3f &wi, const Vector3f &wo, const Vector3f &m,
            bool height_correlated) const {
        Float g = g2(wi, projected_area(wi), wo, projected_area(wo), height_correlated);
        return dr::select(faces(wi, m) && faces(wo, m), g, 0.f);
    }

    /// Density of the normals that `sample` draws, per solid angle; `m` may have any length.
    Float pdf(const Vector3f &wi, const Vector3f &m) const {
        if constexpr (Tables::Single)
            if (!by_core())
                return pdf(View(*this, wi), Facet(*this, m));
        return (Float)m_ndf.pdf(number(m_alpha_u), number(m_alpha_v), to_core(wi), unit(to_core(m)),
                                m_normals);
    }

    /// Draws a normal: `u.x()` selects its slope, `u.y()` its azimuth.
    Sample sample(const Vector3f &wi, const Point2f &u) const {
        if constexpr (Tables::Single)
            if (!by_core())
                return sample(View(*this, wi), u);
        return from_core(m_ndf.sample(number(m_alpha_u), number(m_alpha_v), to_core(wi),
                                      number(u.x()), number(u.y()), m_normals));
    }

    /// All at once: scalar variants cross the bridge once, and what depends on `wi` alone is there
    /// once.
    template <bool Value, bool Pdf>
    Reflected reflected(const Vector3f &wi, const Vector3f &wo, bool height_correlated) const {
        if constexpr (Tables::Single)
            if (!by_core())
                return reflected<Value, Pdf>(View(*this, wi), wo, height_correlated);
        return from_core(m_ndf.reflected(seen_from(wi, height_correlated), to_core(wo)));
    }

    ReflectionSample sample_reflection(const Vector3f &wi, const Point2f &u,
                                       bool height_correlated) const {
        if constexpr (Tables::Single)
            if (!by_core())
                return sample_reflection(View(*this, wi), u, height_correlated);
        return from_core(m_ndf.sample_reflection(seen_from(wi, height_correlated), number(u.x()),
                                                 number(u.y())));
    }

    /// Both for one view.
    std::pair<Reflected, ReflectionSample> reflected_and_sample(const Vector3f &wi,
                                                                const Vector3f &wo,
                                                                const Point2f &u,
                                                                bool height_correlated) const {
        if constexpr (Tables::Single) {
            if (!by_core()) {
                View view(*this, wi);
                return { reflected<true, true>(view, wo, height_correlated),
                         sample_reflection(view, u, height_correlated) };
            }
        }
        auto [r, s] = m_ndf.reflected_and_sample(seen_from(wi, height_correlated), to_core(wo),
                                                 number(u.x()), number(u.y()));
        return { from_core(r), from_core(s) };
    }

private:
    /// Smaller roughness is raised to this
    static constexpr float LeastAlpha = (float)sgtd::host::LeastAlpha;
    /// Least cosine of a normal that is divided by: the square of its inverse is finite
    static constexpr float LeastCos = 1e-18f;
    /// By how much the disc of the azimuths is enlarged, so that single precision tells how wide
    /// their range is, and least share of the radii that is drawn
    static constexpr float Margin     = sgtd::host::HorizonMargin;
    static constexpr float LeastShare = sgtd::host::LeastShare;
    /// Greater values of D are cut off, so that products with them are finite
    static constexpr float GreatestD = 1e30f;

    /// Is the core called instead of reading tables? Never in traced code.
    bool by_core() const { return !dr::is_jit_v<Float> && m_tables.by_core; }

    static double number(const Float &x) { return (double)dr::slice(x); }

    static sgtd::host::Vec3 to_core(const Vector3f &v) {
        return { number(v.x()), number(v.y()), number(v.z()) };
    }

    sgtd::host::Reflection seen_from(const Vector3f &wi, bool height_correlated) const {
        return { number(m_alpha_u), number(m_alpha_v), to_core(wi), height_correlated, m_normals };
    }

    static Sample from_core(const sgtd::host::NormalSample &s) {
        bool valid = s.pdf * s.d_over_pdf * s.m[2] > 1e-20;
        return { Normal3f((Float)s.m[0], (Float)s.m[1], (Float)s.m[2]), valid ? (Float)s.pdf : 0.f,
                 valid ? (Float)s.d_over_pdf : 0.f };
    }

    static ReflectionSample from_core(const sgtd::host::ReflectionSample &s) {
        return { from_core(s.normal), (Float)s.g2 };
    }

    static Reflected from_core(const sgtd::host::Reflected &r) {
        double d = std::min(r.d, (double)GreatestD);
        return { d * r.cos > 1e-20 ? (Float)d : 0.f, (Float)r.g2, (Float)r.pdf };
    }

    /// The greater of `x` and 0. As a selection it is one instruction, as maximum() it is three,
    /// which care for NaN.
    static Float positive(const Float &x) { return dr::select(x > 0.f, x, 0.f); }

    static sgtd::host::Vec3 unit(const sgtd::host::Vec3 &v) {
        double inv_length = 1.0 / std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
        return { v[0] * inv_length, v[1] * inv_length, v[2] * inv_length };
    }

    /// Are `v` and the normal of the surface on the same side of the facet `m`?
    static Mask faces(const Vector3f &v, const Vector3f &m) {
        return dr::dot(v, m) * Frame3f::cos_theta(v) > 0.f;
    }

    // ------------------------------------------------------------------
    //  Normal distribution
    // ------------------------------------------------------------------

    /// The facet along a vector of any length: the slope is rounded less than if it had length 1.
    struct Facet {
        /// Stretched slope; cosine to the normal of the surface, and its inverse
        Float x, y, cos, sec;

        Facet(const SgtdDistribution &distr, const Vector3f &h) {
            Float inv_h = dr::rcp(dr::maximum(h.z(), LeastCos)), square = dr::squared_norm(h),
                  inv_length = dr::rsqrt(square);
            x                = h.x() * inv_h * distr.m_inv_alpha_u;
            y                = h.y() * inv_h * distr.m_inv_alpha_v;
            cos              = h.z() * inv_length;
            sec              = square * inv_length * inv_h;
        }

        /// rho squared
        Float square() const { return dr::fmadd(x, x, dr::square(y)); }
    };

    /// The square root of f at the half vector of two directions, in double precision.
    Float steep_sqrt_f(const Vector3f &wi, const Vector3f &wo) const {
        using Double = typename Tables::Double;
        auto alpha   = [&](const Float &given) {
            return dr::maximum(Double(given) * m_tables.precise_scale, (double)LeastAlpha);
        };
        Double inv_z = dr::rcp(dr::maximum(Double(wi.z()) + Double(wo.z()), (double)LeastCos)),
               x     = (Double(wi.x()) + Double(wo.x())) * inv_z / alpha(m_given_u),
               y     = (Double(wi.y()) + Double(wo.y())) * inv_z / alpha(m_given_v);
        return Float(m_tables.precise_sqrt_f(dr::fmadd(x, x, dr::square(y))));
    }

    /// d(slope area) / d(solid angle), stretched: 1 / (alpha_u alpha_v cos^3)
    Float solid_angle(const Float &sec) const {
        return sec * dr::square(sec) * (m_inv_alpha_u * m_inv_alpha_v);
    }

    /// A f / (pi alpha_u alpha_v cos^4), squared at the end: f may underflow, 1/cos^4 overflow.
    Float density(const Float &sqrt_f, const Float &sec2) const {
        return m_tables.factor * (m_inv_alpha_u * m_inv_alpha_v) * dr::square(sqrt_f * sec2);
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
               entry = bits_of(Tables::template read<Float>(m_tables.lambda, bits >> MantissaBits)),
               shift = entry & 31u,
               cell  = (entry >> 5u) + ((bits & Mantissa) >> shift) + Tables::Entries / 4;
        Float d      = a - dr::reinterpret_array<Float>((bits >> shift) << shift);
        auto cubic   = [](const Vector4f &c, const Float &x) {
            return dr::fmadd(x, dr::fmadd(x, dr::fmadd(x, c.w(), c.z()), c.y()), c.x());
        };
        Float h = cubic(Tables::template read<Vector4f>(m_tables.lambda, cell), d);
        if constexpr (dr::is_diff_v<Float>) {
            if (m_tables.gradient) {
                const ShapeExcess<Float> &excess = m_tables.excess;
                Float at                         = dr::detach(d);
                for (uint32_t k = 0; k < excess.which.size(); ++k)
                    if (excess.which[k])
                        h = dr::fmadd(
                            excess.value[k],
                            cubic(Tables::template read<Vector4f>(
                                      m_tables.gradient->table,
                                      (cell - Tables::Entries / 4) * (uint32_t)excess.which.size() +
                                          k),
                                  at),
                            h);
            }
            if (m_tables.numbers)
                h += m_tables.numbers->masking(cell - Tables::Entries / 4, d);
        }
        return positive(h);
    }

    /// A stretched direction.
    struct Stretched {
        Vector3f w;
        Float c, s, inv_s;
        Mask tilted;

        Stretched(const SgtdDistribution &distr, const Vector3f &v)
            : w(distr.m_alpha_u * v.x(), distr.m_alpha_v * v.y(), v.z()), c(v.z()) {
            Float s2 = dr::fmadd(w.x(), w.x(), dr::square(w.y()));
            tilted   = s2 > 1e-20f;
            s2       = dr::maximum(s2, 1e-20f);
            inv_s    = dr::rsqrt(s2);
            s        = s2 * inv_s;
        }
    };

    Float projected_area(const Stretched &v) const {
        return dr::fmadd(v.s, masked_slope(v.c * v.inv_s), v.c);
    }

    static Float g2(const Vector3f &wi, const Float &area_i, const Vector3f &wo,
                    const Float &area_o, bool height_correlated) {
        Float area = height_correlated ? dr::fmadd(area_i, wo.z(), wi.z() * (area_o - wo.z()))
                                       : area_i * area_o;
        return wi.z() * wo.z() / area;
    }

    // ------------------------------------------------------------------
    //  Reflection
    // ------------------------------------------------------------------

    /// Linear mixture of the rows `index` and `index + 1` of the visible-normal table.
    struct Row {
        UInt32 index;
        /// Weight of the first of the two
        Float weight;
        /// Is there no second one?
        bool alone = false;
    };

    /// A view, with what all that is asked about it shares.
    struct View : Stretched {
        Vector3f wi;
        Float area;
        Row row;
        /// Radii beyond which nothing is reflected upwards, and up to which all azimuths are
        Float far, near;
        /// The share of radii that are drawn
        Float share;

        View(const SgtdDistribution &distr, const Vector3f &wi_)
            : Stretched(distr, wi_), wi(wi_), area(distr.projected_area(*this)) {
            row = distr.m_normals == Normals::All ? normal_row() : distr.row_of(*this);
            if (distr.m_normals == Normals::Reflecting) {
                distr.limit(*this);
                share = distr.share_below(row, dr::square(far));
            }
        }
    };

    /**
     * A facet reflects the view upwards if its slope is less than sec(theta) from that of the view:
     * a disc in slopes, for one roughness also in stretched ones. For two, the radius is that of a
     * circle around it.
     */
    void limit(View &view) const {
        const Vector3f &w = view.wi;
        Float cos         = dr::maximum(w.z(), LeastCos);
        if (m_one_roughness) {
            Float rest = 1.f + dr::safe_sqrt(dr::fmadd(w.x(), w.x(), dr::square(w.y())));
            view.far   = rest / cos * m_inv_alpha_u;
            view.near  = cos / rest * m_inv_alpha_u;
        } else {
            view.far = (dr::sqrt(dr::maximum(dr::square(w.x() * m_inv_alpha_u) +
                                                 dr::square(w.y() * m_inv_alpha_v),
                                             1e-20f)) +
                        dr::maximum(m_inv_alpha_u, m_inv_alpha_v)) /
                       cos;
        }
        view.far = dr::minimum(view.far, 1e15f);
    }

    /// Azimuths at the slope rho, whose square is `y`.
    Azimuth<Float> azimuth(const View &view, const Float &y) const {
        Float rho = dr::sqrt(dr::maximum(y, 1e-20f));
        if (m_normals != Normals::Reflecting || !m_one_roughness)
            return { view.c, view.s * rho };
        constexpr float Wider = 1.f + Margin;
        Float far = Wider * view.far, near = Wider * view.near;
        return Azimuth<Float>::within(
            view.c, view.s * rho, (far - rho) * (rho + near), (rho + far) * (rho - near),
            dr::fmadd(dr::square(m_alpha_u) * (1.f / Wider), y, 1.f - Margin));
    }

    /// Density of a facet under `sample`.
    Float pdf(const View &view, const Facet &facet) const {
        Float y = facet.square(), radial = radial_pdf(view.row, y), azimuthal;
        if (m_normals == Normals::All) {
            azimuthal = dr::InvPi<Float>;
        } else {
            Azimuth<Float> range = azimuth(view, y);
            Float facing =
                dr::fmadd(view.w.x(), facet.x, dr::fmadd(view.w.y(), facet.y, view.w.z()));
            azimuthal = facing * range.inv_sum / range.mass;
            if (m_normals == Normals::Reflecting)
                azimuthal /= view.share;
        }
        Float stretched = radial * azimuthal;
        Float result    = dr::select(stretched > 0.f, stretched * solid_angle(facet.sec), 0.f);
        if constexpr (dr::is_diff_v<Float>)
            if (m_tables.follows())
                result *= dr::replace_grad(Float(1.f), relative_to_shape(view, y));
        return result;
    }

    /**
     * The density of a facet in units of itself, for its gradient by the shape: that of the visible
     * normals, D (wi.m) / projected area, or of all of them, D cos. (The tables that are drawn from
     * are those of the shape as it is. The share of the radii that a bound leaves has no gradient.)
     */
    Float relative_to_shape(const View &view, const Float &y) const {
        Float root = m_tables.sqrt_f(dr::detach(y)), at = dr::maximum(dr::detach(root), 1e-18f),
              result = m_tables.factor / dr::detach(m_tables.factor) * dr::square(root / at);
        if (m_normals != Normals::All) {
            Float c = dr::detach(view.c), s = dr::detach(view.s),
                  area = dr::fmadd(s, masked_slope(c * dr::detach(view.inv_s)), c);
            result *= dr::detach(area) / area;
        }
        return result;
    }

    Sample sample(const View &view, const Point2f &u) const {
        Float sin_phi, cos_phi, azimuthal, radial, y, root;
        if (m_normals == Normals::All) {
            std::tie(y, radial, root)  = sample_radius(view.row, u.x());
            std::tie(sin_phi, cos_phi) = dr::sincos(dr::TwoPi<Float> * u.y());
            azimuthal                  = dr::InvPi<Float>;
        } else {
            bool bounded = m_normals == Normals::Reflecting;
            std::tie(y, radial, root) =
                sample_radius(view.row, bounded ? u.x() * view.share : u.x());
            if (bounded)
                radial /= view.share;
            Azimuth<Float> range    = azimuth(view, y);
            auto terms              = range.solve(1.f - dr::abs(dr::fmsub(2.f, u.y(), 1.f)));
            auto [sin_rel, cos_rel] = range.sincos(terms);
            sin_rel                 = dr::select(u.y() < .5f, -sin_rel, sin_rel);
            // The azimuth is counted from that of the view
            Float sin_view = dr::select(view.tilted, view.w.y() * view.inv_s, 0.f),
                  cos_view = dr::select(view.tilted, view.w.x() * view.inv_s, 1.f);
            sin_phi        = dr::fmadd(sin_view, cos_rel, cos_view * sin_rel);
            cos_phi        = dr::fmsub(cos_view, cos_rel, sin_view * sin_rel);
            azimuthal      = terms.slope / range.mass;
        }

        Float rho = dr::sqrt(dr::maximum(y, 1e-20f));
        Vector3f m(m_alpha_u * rho * cos_phi, m_alpha_v * rho * sin_phi, 1.f);
        Float square = dr::squared_norm(m), cos = dr::rsqrt(square), sec = square * cos,
              stretched = radial * azimuthal, d = density(root, square);
        m *= cos;
        Mask valid = stretched > 1e-36f && d > 1e-20f * sec;
        // f / stretched: inside a ring both are so small that the derivative, which has the
        // square of the divisor in it, would overflow
        Float ratio = dr::square(root / dr::sqrt(dr::maximum(stretched, 1e-36f)));
        return { Normal3f(m), dr::select(valid, stretched * solid_angle(sec), 0.f),
                 dr::select(valid, m_tables.factor * ratio * sec, 0.f) };
    }

    template <bool Value, bool Pdf>
    Reflected reflected(const View &view, const Vector3f &wo, bool height_correlated) const {
        Reflected result{ Float(0.f), Float(0.f), Float(0.f) };
        if constexpr (Value) {
            result.d = eval(view.wi, wo);
            result.g = g2(view.wi, view.area, wo, projected_area(wo), height_correlated);
        }
        if constexpr (Pdf)
            result.pdf = pdf(view, Facet(*this, view.wi + wo));
        return result;
    }

    ReflectionSample sample_reflection(const View &view, const Point2f &u,
                                       bool height_correlated) const {
        Sample drawn = sample(view, u);
        Vector3f wo  = reflect(view.wi, drawn.m);
        return { drawn, g2(view.wi, view.area, wo, projected_area(wo), height_correlated) };
    }

    // ------------------------------------------------------------------
    //  Sampling: radius
    // ------------------------------------------------------------------

    /**
     * Rows are spaced evenly in c / (c + s b).
     *
     * The distance from the last one is what is computed: far out in the tail the row before it
     * outweighs the last one even at a weight of 1e-4, which a difference from 1 would garble.
     */
    Row row_of(const Stretched &view) const {
        Float sb = view.s * m_tables.scale, c = positive(view.c),
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
    Block knot_block(const UInt32 &k) const {
        return Tables::template read<Block>(m_tables.visible, k);
    }

    /// Block `k` of the masses above the knots; 0 is that of every eighth knot.
    Block mass_block(const Row &row, const UInt32 &k) const {
        constexpr uint32_t Next = Tables::RowSize / Tables::Block;
        UInt32 index            = row.index * Next + k + Next;
        Block first             = Tables::template read<Block>(m_tables.visible, index);
        if (!row.alone) {
            Block second = Tables::template read<Block>(m_tables.visible, index + Next);
            for (size_t i = 0; i < Tables::Block; ++i)
                first[i] = mix(row, first[i], second[i]);
        }
        return first;
    }

    /// Where a list passes some value: the last cell whose left knot is on this side of it, and
    /// what the list holds at the two ends of that cell.
    struct Place {
        UInt32 cell;
        Float left, right;
    };

    /// The last cell whose left knot `holds`, which is taken for granted at the first of a block.
    template <typename Blocks, typename Holds>
    static Place find(const Blocks &block, const Holds &holds) {
        Place place{ UInt32(0u), Float(0.f), Float(0.f) };
        auto descend = [&](const Block &values) {
            if constexpr (!dr::is_jit_v<Float>) {
                uint32_t n = 0;
                for (uint32_t i = 1; i < Tables::Block; ++i)
                    n += holds(values[i]);
                place.left = values[n];
                if (n + 1 < Tables::Block)
                    place.right = values[n + 1];
                return n;
            }
            UInt32 n    = 0u;
            Float after = place.right;
            place.left  = values[0];
            place.right = values[1];
            for (uint32_t i = 1; i < Tables::Block; ++i) {
                Mask before = holds(values[i]);
                n           = dr::select(before, UInt32(i), n);
                place.left  = dr::select(before, values[i], place.left);
                place.right =
                    dr::select(before, i + 1 < Tables::Block ? values[i + 1] : after, place.right);
            }
            return n;
        };
        UInt32 k   = descend(block(UInt32(0u)));
        place.cell = k * Tables::Block + descend(block(k + 1u));
        return place;
    }

    /// Cell of a monotone rational-quadratic spline (Gregory & Delbourgo 1982): mass over y =
    /// rho^2.
    struct Cell {
        /// Width, mass and its inverse; densities at both ends in units of mass / width
        Float width, mass, inv_mass, d0, d1;

        Cell(const Float &width_, const Float &mass_, const Float &g0, const Float &g1)
            : width(width_), mass(mass_), inv_mass(dr::rcp(dr::maximum(mass_, 1e-30f))),
              d0(g0 * width_ * inv_mass), d1(g1 * width_ * inv_mass) {}

        /// Density at the fraction tau of the cell
        Float density(const Float &tau) const {
            Float rest = tau * (1.f - tau),
                  top  = dr::fmadd(d1, dr::square(tau),
                                   dr::fmadd(2.f, rest, d0 * dr::square(1.f - tau))),
                  base = dr::fmadd(d0 + d1 - 2.f, rest, 1.f);
            return mass * top / (width * dr::square(base));
        }

        /// Mass below the fraction tau of the cell
        Float below(const Float &tau) const {
            Float rest = tau * (1.f - tau);
            return mass * dr::fmadd(tau, tau, d0 * rest) / dr::fmadd(d0 + d1 - 2.f, rest, 1.f);
        }

        /// The fraction tau of the cell below which `part` of its mass lies
        Float invert(const Float &part) const {
            Float q = share(part * inv_mass), k = d0 + d1 - 2.f, b = dr::fnmadd(q, k, d0),
                  root = dr::sqrt(dr::maximum(dr::fmadd(b, b, 4.f * q * (1.f - b)), 1e-30f));
            return share(2.f * q / dr::maximum(b + root, 1e-30f));
        }
    };

    /// `x` limited to [0, 1]
    static Float share(const Float &x) { return dr::minimum(positive(x), 1.f); }

    /// Cell `j` of a row, whose width the caller has from the knots.
    Cell cell_at(const Row &row, const UInt32 &j, const Float &width) const {
        // Mass, and the upper halves of the bits of two densities
        auto load = [&](const UInt32 &index) {
            Vector2f pair = Tables::template read<Vector2f>(m_tables.visible, index);
            UInt32 bits   = dr::reinterpret_array<UInt32>(dr::detach(pair.y()));
            return Vector3f(pair.x(), dr::reinterpret_array<Float>(bits & 0xffff0000u),
                            dr::reinterpret_array<Float>(bits << 16u));
        };
        constexpr uint32_t Next = Tables::RowSize / 2;
        UInt32 k                = row.index * Next + j + (Next + Tables::List / 2);
        Vector3f a = load(k), b = row.alone ? a : load(k + Next);
        return Cell(width, mix(row, a.x(), b.x()), mix(row, a.y(), b.y()), mix(row, a.z(), b.z()));
    }

    /// The last cell: normals so steep that their reflection is below the horizon. Never drawn.
    static constexpr uint32_t LostCell = Tables::Cells - 1;

    /// The rate of the odds y = F / (1 - F) in rho^2.
    Float odds_rate(const Float &sqrt_f, const Float &odds) const {
        Float root = sqrt_f * (1.f + odds);
        return dr::Pi<Float> * m_tables.factor * dr::square(root);
    }

    /// Draws y = rho^2; returns it with its density, which is 0 if the sample is lost, and with the
    /// square root of f.
    std::tuple<Float, Float, Float> sample_radius(const Row &row, const Float &u) const {
        auto [y, density] = sample_spline(row, u);
        if (!m_tables.by_odds)
            return { y, density, m_tables.sqrt_f(y) };
        auto [square, sqrt_f] = m_tables.cells.draw(y);
        return { square, density * odds_rate(sqrt_f, y), sqrt_f };
    }

    /// Draws what the spline is over; returns it with its density, which is 0 if it is lost.
    std::pair<Float, Float> sample_spline(const Row &row, const Float &u) const {
        Float target   = 1.f - u;
        Place place    = find([&](const UInt32 &k) { return mass_block(row, k); },
                           [&](const Float &mass) { return mass >= target; });
        Mask lost      = place.cell == LostCell;
        UInt32 j       = dr::minimum(place.cell, LostCell - 1);
        Vector2f knots = Tables::template read<Vector2f>(m_tables.visible, j + Tables::List / 2);
        Cell cell      = cell_at(row, j, knots.y());
        Float tau      = cell.invert(place.left - target);
        return { dr::fmadd(tau, cell.width, knots.x()), dr::select(lost, 0.f, cell.density(tau)) };
    }

    /// Where a slope is among the knots.
    Place place_of(const Float &y) const {
        return find([&](const UInt32 &k) { return knot_block(k); },
                    [&](const Float &knot) { return knot <= y; });
    }

    /// The share of what `sample_radius` draws that is below y. Masses are counted from above, so
    /// what is left of 1 cannot be smaller than LeastShare and still be divided; the rest is drawn
    /// in vain.
    Float share_below(const Row &row, const Float &square) const {
        Float y      = m_tables.by_odds ? m_tables.cells.at(square).odds : square;
        Place place  = place_of(y);
        UInt32 index = (row.index + 1u) * Tables::RowSize + place.cell + Tables::Block;
        Float above  = Tables::template read<Float>(m_tables.visible, index);
        if (!row.alone)
            above = mix(row, above,
                        Tables::template read<Float>(m_tables.visible, index + Tables::RowSize));
        Cell cell  = cell_at(row, place.cell, place.right - place.left);
        Float part = cell.below(share((y - place.left) / cell.width));
        return dr::maximum(1.f - above + dr::select(place.cell == LostCell, 0.f, part), LeastShare);
    }

    /// Density of y = rho^2 under `sample_radius`.
    Float radial_pdf(const Row &row, const Float &y) const {
        if (!m_tables.by_odds)
            return spline_pdf(row, y);
        auto [sqrt_f, odds] = m_tables.cells.at(y);
        return spline_pdf(row, odds) * odds_rate(sqrt_f, odds);
    }

    /// Density of y under `sample_spline`.
    Float spline_pdf(const Row &row, const Float &y) const {
        Place place = place_of(y);
        Cell cell   = cell_at(row, place.cell, place.right - place.left);
        Float tau   = share((y - place.left) / cell.width);
        return dr::select(place.cell == LostCell, 0.f, cell.density(tau));
    }

private:
    const sgtd::host::Ndf &m_ndf;
    const Tables &m_tables;
    /// The roughness that was given, times its factor, and the inverse of that
    Float m_given_u, m_given_v, m_alpha_u, m_alpha_v, m_inv_alpha_u, m_inv_alpha_v;
    Normals m_normals;
    bool m_one_roughness;
};

NAMESPACE_END(mitsuba)
