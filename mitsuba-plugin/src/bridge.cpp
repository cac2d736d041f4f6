#include "bridge.h"

#include <map>
#include <mutex>
#include <stdexcept>
#include <tuple>

#include "rust/cxx.h"
#include "sgtd-core/src/bridge.rs.h"

namespace sgtd::host {

namespace {

/// Runs a call into the core and turns its error into an exception of the standard library.
template <typename Call> auto checked(Call &&call) {
    try {
        return call();
    } catch (const rust::Error &error) {
        throw std::invalid_argument(error.what());
    }
}

sgtd::Given given(std::optional<double> value) {
    return { value.has_value(), value.value_or(0.0) };
}

sgtd::Vec3 to_core(const Vec3 &v) { return { v[0], v[1], v[2] }; }

sgtd::Shape to_core(const Shape &shape) {
    return { shape.gamma, shape.p, shape.lambda, shape.shift };
}

Shape from_core(const sgtd::Shape &shape) {
    return { shape.gamma, shape.p, shape.lambda, shape.shift };
}

template <typename T> rust::Slice<T> to_core(Slice<T> slice) { return { slice.data, slice.size }; }

/// Equal keys share one value for as long as somebody holds it.
///
/// There is one slot per distinct key. A slot has its own lock, so that scene loading threads that
/// want different values do not wait for each other, and those that want the same one build it
/// once.
template <typename Key, typename Value> class Shared {
public:
    template <typename Build> std::shared_ptr<const Value> get(const Key &key, const Build &build) {
        if (key != key)
            return build(); // not a number: cannot be a key, and the core says which one it is
        std::shared_ptr<Slot> slot = slot_of(key);
        std::lock_guard<std::mutex> guard(slot->mutex);
        std::shared_ptr<const Value> result = slot->value.lock();
        if (!result) {
            result      = build();
            slot->value = result;
        }
        return result;
    }

private:
    struct Slot {
        std::mutex mutex;
        std::weak_ptr<const Value> value;
    };

    std::shared_ptr<Slot> slot_of(const Key &key) {
        std::lock_guard<std::mutex> guard(m_mutex);
        // Slots without users are dropped: the optimization of a shape visits thousands of them
        for (auto it = m_slots.begin(); it != m_slots.end();) {
            bool unused = it->second.use_count() == 1 && it->second->value.expired();
            it          = unused ? m_slots.erase(it) : std::next(it);
        }
        std::shared_ptr<Slot> &entry = m_slots[key];
        if (!entry)
            entry = std::make_shared<Slot>();
        return entry;
    }

    std::mutex m_mutex;
    std::map<Key, std::shared_ptr<Slot>> m_slots;
};

} // namespace

RowShape shape_of_row(std::string_view row, std::optional<double> gamma, std::optional<double> p,
                      std::optional<double> lambda, std::optional<double> shift) {
    return checked([&] {
        sgtd::RowShape result = sgtd::shape_of_row(rust::Str(row.data(), row.size()), given(gamma),
                                                   given(p), given(lambda), given(shift));
        return RowShape{ from_core(result.shape), result.alpha_scale };
    });
}

Node lowest_node(const Shape &shape) {
    return checked([&] {
        sgtd::Node node = sgtd::lowest_node(to_core(shape));
        return Node{ std::string(node.name), from_core(node.shape), node.alpha_scale,
                     node.closed_form };
    });
}

size_t first_of_wrong_length(Slice<const double> w, double tolerance) {
    return sgtd::first_of_wrong_length(to_core(w), tolerance);
}

size_t first_outside(Slice<const double> x, double low, double high) {
    return sgtd::first_outside(to_core(x), low, high);
}

struct Ndf::Impl {
    rust::Box<sgtd::Ndf> core;
    Shape shape;
    double accuracy;
};

Ndf::Ndf(std::unique_ptr<Impl> impl) : m_impl(std::move(impl)) {}
Ndf::~Ndf() = default;

std::shared_ptr<const Ndf> Ndf::get(const Shape &shape, double accuracy, bool visible) {
    static Shared<std::tuple<double, double, double, double, double, bool>, Ndf> shared;
    return shared.get({ shape.gamma, shape.p, shape.lambda, shape.shift, accuracy, visible }, [&] {
        rust::Box<sgtd::Ndf> core =
            checked([&] { return sgtd::new_ndf(to_core(shape), accuracy, visible); });
        return std::shared_ptr<const Ndf>(
            new Ndf(std::unique_ptr<Impl>(new Impl{ std::move(core), shape, accuracy })));
    });
}

Tables Ndf::tables() const {
    sgtd::TableHeader header         = m_impl->core->header();
    rust::Slice<const float> lambda  = m_impl->core->lambda_table();
    rust::Slice<const float> visible = m_impl->core->visible_table();
    Tables result;
    result.normalization    = header.normalization;
    result.scale            = header.scale;
    result.accuracy_reached = header.accuracy_reached;
    result.steepness        = header.steepness;
    result.lambda_entries   = header.lambda_entries;
    result.visible_rows     = header.visible_rows;
    result.visible_cells    = header.visible_cells;
    result.lambda           = { lambda.data(), lambda.size() };
    result.visible          = { visible.data(), visible.size() };
    return result;
}

static std::shared_ptr<const Losses> to_host(const sgtd::AlbedoTable &core) {
    sgtd::AlbedoHeader header     = core.albedo_header();
    rust::Slice<const float> flat = core.flat();
    Losses result;
    result.slope          = header.slope;
    result.power          = header.power;
    result.end            = header.end;
    result.spread         = header.spread;
    result.greatest       = header.greatest;
    result.least_alpha    = header.least_alpha;
    result.greatest_alpha = header.greatest_alpha;
    result.average_log    = header.average_log;
    result.average_u      = header.average_u;
    result.average_v      = header.average_v;
    result.reached        = header.reached;
    result.views          = header.views;
    result.columns        = header.columns;
    result.table.assign(flat.begin(), flat.end());
    return std::make_shared<const Losses>(std::move(result));
}

/// The pair is (0, 0) for tables of every isotropic roughness.
using LossesKey = std::tuple<double, double, double, double, double, bool, double, double>;
static Shared<LossesKey, Losses> shared_losses;

std::shared_ptr<const Losses> Ndf::losses(bool correlated) const {
    const Shape &shape = m_impl->shape;
    return shared_losses.get(
        { shape.gamma, shape.p, shape.lambda, shape.shift, m_impl->accuracy, correlated, 0.0, 0.0 },
        [&] { return to_host(*sgtd::new_isotropic_albedo(*m_impl->core, correlated)); });
}

std::shared_ptr<const Losses> Ndf::losses(bool correlated, double alpha_u, double alpha_v) const {
    const Shape &shape = m_impl->shape;
    return shared_losses.get({ shape.gamma, shape.p, shape.lambda, shape.shift, m_impl->accuracy,
                               correlated, alpha_u, alpha_v },
                             [&] {
                                 return checked([&] {
                                     return to_host(*sgtd::new_anisotropic_albedo(
                                         *m_impl->core, correlated, alpha_u, alpha_v));
                                 });
                             });
}

double Ndf::d(double alpha_u, double alpha_v, const Vec3 &m) const {
    return m_impl->core->d(alpha_u, alpha_v, to_core(m));
}

double Ndf::projected_area(double alpha_u, double alpha_v, const Vec3 &w) const {
    return m_impl->core->projected_area(alpha_u, alpha_v, to_core(w));
}

double Ndf::pdf(double alpha_u, double alpha_v, const Vec3 &wi, const Vec3 &m, bool visible) const {
    return m_impl->core->pdf(alpha_u, alpha_v, to_core(wi), to_core(m), visible);
}

NormalSample Ndf::sample(double alpha_u, double alpha_v, const Vec3 &wi, double u1, double u2,
                         bool visible) const {
    sgtd::NormalSample s = m_impl->core->sample(alpha_u, alpha_v, to_core(wi), u1, u2, visible);
    return { { s.m.x, s.m.y, s.m.z }, s.pdf, s.d_over_pdf };
}

void Ndf::d_batch(double alpha_u, double alpha_v, In m, Out out) const {
    checked([&] { m_impl->core->d_batch(alpha_u, alpha_v, to_core(m), to_core(out)); });
}

void Ndf::lambda_batch(double alpha_u, double alpha_v, In w, Out out) const {
    checked([&] { m_impl->core->lambda_batch(alpha_u, alpha_v, to_core(w), to_core(out)); });
}

void Ndf::g1_batch(double alpha_u, double alpha_v, In w, Out out) const {
    checked([&] { m_impl->core->g1_batch(alpha_u, alpha_v, to_core(w), to_core(out)); });
}

void Ndf::g2_batch(double alpha_u, double alpha_v, In wi, In wo, bool correlated, Out out) const {
    checked([&] {
        m_impl->core->g2_batch(alpha_u, alpha_v, to_core(wi), to_core(wo), correlated,
                               to_core(out));
    });
}

void Ndf::pdf_batch(double alpha_u, double alpha_v, In wi, In m, bool visible, Out out) const {
    checked([&] {
        m_impl->core->pdf_batch(alpha_u, alpha_v, to_core(wi), to_core(m), visible, to_core(out));
    });
}

void Ndf::sample_batch(double alpha_u, double alpha_v, In wi, In u, bool visible, Out m,
                       Out pdf) const {
    checked([&] {
        m_impl->core->sample_batch(alpha_u, alpha_v, to_core(wi), to_core(u), visible, to_core(m),
                                   to_core(pdf));
    });
}

void Ndf::profile_batch(In x, Out out) const {
    checked([&] { m_impl->core->profile_batch(to_core(x), to_core(out)); });
}

void Ndf::cdf_batch(In x, Out out) const {
    checked([&] { m_impl->core->cdf_batch(to_core(x), to_core(out)); });
}

void Ndf::sf_batch(In x, Out out) const {
    checked([&] { m_impl->core->sf_batch(to_core(x), to_core(out)); });
}

void Ndf::quantile_batch(In u, Out out) const {
    checked([&] { m_impl->core->quantile_batch(to_core(u), to_core(out)); });
}

void Ndf::isf_batch(In s, Out out) const {
    checked([&] { m_impl->core->isf_batch(to_core(s), to_core(out)); });
}

} // namespace sgtd::host
