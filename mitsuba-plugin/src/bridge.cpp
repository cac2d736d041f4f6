#include "bridge.h"

#include <atomic>
#include <map>
#include <mutex>
#include <stdexcept>
#include <tuple>

#include <pthread.h>

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

Shape from_core(const std::array<double, 4> &shape) {
    return { shape[0], shape[1], shape[2], shape[3] };
}

rust::Str to_core(std::string_view text) { return { text.data(), text.size() }; }

sgtd::Normals to_core(Normals normals) {
    switch (normals) {
    case Normals::All:
        return sgtd::Normals::All;
    case Normals::Reflecting:
        return sgtd::Normals::Reflecting;
    default:
        return sgtd::Normals::Visible;
    }
}

sgtd::Reflection to_core(const Reflection &view) {
    return { view.alpha_u, view.alpha_v, to_core(view.wi), view.correlated, to_core(view.normals) };
}

NormalSample from_core(const sgtd::NormalSample &s) {
    return { { s.m.x, s.m.y, s.m.z }, s.pdf, s.d_over_pdf };
}

Reflected from_core(const sgtd::Reflected &r) { return { r.d, r.cos, r.g2, r.pdf }; }

ReflectionSample from_core(const sgtd::ReflectionSample &s) {
    return { from_core(s.normal), s.g2 };
}

template <typename T> rust::Slice<T> to_core(Slice<T> slice) { return { slice.data, slice.size }; }

/// Equal keys share one value for as long as somebody holds it.
///
/// There is one slot per distinct key. A slot has its own lock, so that scene loading threads that
/// want different values do not wait for each other, and those that want the same one build it
/// once. The child of a fork starts with no slots: a thread that it lacks may hold any of the
/// locks.
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

    /// What was shared so far stays with those who hold it.
    void forget() { m_slots.store(nullptr); }

private:
    struct Slot {
        std::mutex mutex;
        std::weak_ptr<const Value> value;
    };

    struct Slots {
        std::mutex mutex;
        std::map<Key, std::shared_ptr<Slot>> by_key;
    };

    std::shared_ptr<Slot> slot_of(const Key &key) {
        Slots &slots = this_process();
        std::lock_guard<std::mutex> guard(slots.mutex);
        // Slots without users are dropped: the optimization of a shape visits thousands of them
        for (auto it = slots.by_key.begin(); it != slots.by_key.end();) {
            bool unused = it->second.use_count() == 1 && it->second->value.expired();
            it          = unused ? slots.by_key.erase(it) : std::next(it);
        }
        std::shared_ptr<Slot> &entry = slots.by_key[key];
        if (!entry)
            entry = std::make_shared<Slot>();
        return entry;
    }

    Slots &this_process() {
        Slots *found = m_slots.load();
        if (!found) {
            auto made = std::make_unique<Slots>();
            if (m_slots.compare_exchange_strong(found, made.get()))
                found = made.release(); // never freed: threads may outlive the end of main()
        }
        return *found;
    }

    std::atomic<Slots *> m_slots = nullptr;
};

/// A distribution, its accuracy, and whether it has visible normals.
using NdfKey = std::tuple<std::string, double, bool>;
Shared<NdfKey, Ndf> shared_ndfs;

/// The pair is (0, 0) for tables of every isotropic roughness.
using MissingEnergyKey = std::tuple<std::string, double, bool, double, double>;
Shared<MissingEnergyKey, MissingEnergy> shared_missing_energies;

using InterfaceKey = std::tuple<std::string, double, bool, double, double, double, bool>;
Shared<InterfaceKey, Interface> shared_interfaces;

/// Runs in the child of every fork, where only stores are safe.
void forget_parent() {
    shared_ndfs.forget();
    shared_missing_energies.forget();
    shared_interfaces.forget();
    sgtd::forget_threads();
}

[[maybe_unused]] const int registered = pthread_atfork(nullptr, nullptr, forget_parent);

} // namespace

RowShape shape_of_row(std::string_view row, std::optional<double> gamma, std::optional<double> p,
                      std::optional<double> lambda, std::optional<double> shift) {
    return checked([&] {
        sgtd::RowShape result =
            sgtd::shape_of_row(to_core(row), given(gamma), given(p), given(lambda), given(shift));
        return RowShape{ from_core(result.shape), result.alpha_scale };
    });
}

Node lowest_node(const Shape &shape) {
    return checked([&] {
        sgtd::Node node = sgtd::lowest_node(shape.numbers());
        return Node{ std::string(node.name), from_core(node.shape), node.alpha_scale,
                     node.closed_form };
    });
}

void check_roughness(double alpha_u, double alpha_v) {
    checked([&] { sgtd::check_roughness(alpha_u, alpha_v); });
}

size_t first_of_wrong_length(Slice<const double> w, double tolerance) {
    return sgtd::first_of_wrong_length(to_core(w), tolerance);
}

size_t first_outside(Slice<const double> x, double low, double high) {
    return sgtd::first_outside(to_core(x), low, high);
}

struct Radial::Impl {
    rust::Box<sgtd::Radial> core;
};

Radial::Radial(std::unique_ptr<Impl> impl) : m_impl(std::move(impl)) {
    rust::Slice<const uint8_t> key = m_impl->core->key();
    m_key.assign(reinterpret_cast<const char *>(key.data()), key.size());
}
Radial::~Radial() = default;

Radial::Pointer Radial::family(const Shape &shape) {
    return checked([&] {
        return Pointer(
            new Radial(std::make_unique<Impl>(Impl{ sgtd::radial_of_shape(shape.numbers()) })));
    });
}

Radial::Pointer Radial::table(const TableSource &source) {
    return checked([&] {
        sgtd::TableSource to;
        for (double place : source.places)
            to.places.push_back(place);
        for (double value : source.values)
            to.values.push_back(value);
        to.by_angles     = source.by_angles;
        to.quantity      = source.quantity;
        to.tail          = source.tail;
        to.tail_exponent = given(source.tail_exponent);
        to.knee          = given(source.knee);
        to.path          = source.path;
        return Pointer(new Radial(std::make_unique<Impl>(Impl{ sgtd::radial_of_table(to) })));
    });
}

TableSource TableSource::read(std::string_view path, std::string_view quantity,
                              std::string_view tail, std::optional<double> tail_exponent) {
    return checked([&] {
        sgtd::TableSource from =
            sgtd::read_table(to_core(path), to_core(quantity), to_core(tail), given(tail_exponent));
        auto number = [](const sgtd::Given &x) {
            return x.set ? std::optional<double>(x.value) : std::nullopt;
        };
        return TableSource{ { from.places.begin(), from.places.end() },
                            from.by_angles,
                            { from.values.begin(), from.values.end() },
                            std::string(from.quantity),
                            std::string(from.tail),
                            number(from.tail_exponent),
                            number(from.knee),
                            std::string(from.path) };
    });
}

Radial::Pointer Radial::mixture(const std::vector<Part> &parts) {
    return checked([&] {
        rust::Box<sgtd::Parts> to = sgtd::new_parts();
        for (const Part &part : parts)
            to->add(part.weight, part.alpha, *part.radial->m_impl->core);
        return Pointer(new Radial(std::make_unique<Impl>(Impl{ sgtd::radial_of_mixture(*to) })));
    });
}

Radial::Pointer Radial::resampled(size_t nodes) const {
    return checked([&] {
        return Pointer(new Radial(std::make_unique<Impl>(Impl{ m_impl->core->resampled(nodes) })));
    });
}

bool Radial::is_family() const { return m_impl->core->kind() == sgtd::Kind::Family; }
bool Radial::is_table() const { return m_impl->core->kind() == sgtd::Kind::Table; }
double Radial::width() const { return m_impl->core->width(); }

std::vector<double> Radial::slopes() const {
    rust::Vec<double> slopes = m_impl->core->slopes();
    return { slopes.begin(), slopes.end() };
}

std::vector<double> Radial::slope_densities() const {
    rust::Vec<double> densities = m_impl->core->slope_densities();
    return { densities.begin(), densities.end() };
}

double Radial::knee() const { return m_impl->core->ends().knee; }
double Radial::tail_exponent() const { return m_impl->core->ends().tail_exponent; }

struct Ndf::Impl {
    rust::Box<sgtd::Ndf> core;
    std::string key;
    double accuracy;
};

Ndf::Ndf(std::unique_ptr<Impl> impl) : m_impl(std::move(impl)) {}
Ndf::~Ndf() = default;

std::shared_ptr<const Ndf> Ndf::get(const Radial &radial, double accuracy, bool visible) {
    return shared_ndfs.get({ radial.key(), accuracy, visible }, [&] {
        rust::Box<sgtd::Ndf> core =
            checked([&] { return sgtd::new_ndf(*radial.m_impl->core, accuracy, visible); });
        return std::shared_ptr<const Ndf>(
            new Ndf(std::unique_ptr<Impl>(new Impl{ std::move(core), radial.key(), accuracy })));
    });
}

Numbers Ndf::numbers() const {
    sgtd::Numbers numbers = m_impl->core->numbers();
    return { numbers.normalization, numbers.accuracy_reached, numbers.mean, numbers.by_odds };
}

Tables Ndf::tables() const {
    sgtd::TableHeader header         = m_impl->core->header();
    rust::Slice<const float> lambda  = m_impl->core->lambda_table();
    rust::Slice<const float> visible = m_impl->core->visible_table();
    Tables result;
    static_cast<Numbers &>(result) = numbers();
    result.scale                   = header.scale;
    result.steepness               = header.steepness;
    result.lambda_entries          = header.lambda_entries;
    result.visible_rows            = header.visible_rows;
    result.visible_cells           = header.visible_cells;
    result.lambda                  = { lambda.data(), lambda.size() };
    result.visible                 = { visible.data(), visible.size() };
    result.cells                   = { m_impl->core->cells().data(), m_impl->core->cells().size() };
    if (header.steepness > Steep) // it is made when it is asked for
        result.precise_cells = { m_impl->core->precise_cells().data(),
                                 m_impl->core->precise_cells().size() };
    return result;
}

static std::shared_ptr<const MissingEnergy> to_host(const sgtd::AlbedoTable &core) {
    sgtd::AlbedoHeader header     = core.albedo_header();
    rust::Slice<const float> flat = core.flat();
    MissingEnergy result;
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
    return std::make_shared<const MissingEnergy>(std::move(result));
}

std::shared_ptr<const MissingEnergy> Ndf::missing_energy(bool correlated) const {
    return shared_missing_energies.get(
        { m_impl->key, m_impl->accuracy, correlated, 0.0, 0.0 },
        [&] { return to_host(*sgtd::new_isotropic_albedo(*m_impl->core, correlated)); });
}

std::shared_ptr<const MissingEnergy> Ndf::missing_energy(bool correlated, double alpha_u,
                                                         double alpha_v) const {
    return shared_missing_energies.get(
        { m_impl->key, m_impl->accuracy, correlated, alpha_u, alpha_v }, [&] {
            return checked([&] {
                return to_host(
                    *sgtd::new_anisotropic_albedo(*m_impl->core, correlated, alpha_u, alpha_v));
            });
        });
}

std::shared_ptr<const Interface> Ndf::interface(bool correlated, double alpha_u, double alpha_v,
                                                double eta, bool transmittance) const {
    return shared_interfaces.get(
        { m_impl->key, m_impl->accuracy, correlated, alpha_u, alpha_v, eta, transmittance }, [&] {
            return checked([&] {
                rust::Box<sgtd::InterfaceTable> core = sgtd::new_interface_table(
                    *m_impl->core, correlated, alpha_u, alpha_v, eta, transmittance);
                sgtd::InterfaceHeader header  = core->interface_header();
                rust::Slice<const float> flat = core->flat();
                Interface result;
                result.columns              = header.columns;
                result.critical             = header.critical;
                result.average              = header.average;
                result.internal_reflectance = header.internal_reflectance;
                result.facet_reflectance    = header.facet_reflectance;
                result.table.assign(flat.begin(), flat.end());
                return std::make_shared<const Interface>(std::move(result));
            });
        });
}

Gradient Ndf::gradient() const {
    return checked([&] {
        rust::Box<sgtd::GradientTable> core = sgtd::new_gradient_table(*m_impl->core);
        rust::Slice<const float> flat       = core->flat();
        Gradient result;
        result.log_normalization = core->log_normalization();
        result.table.assign(flat.begin(), flat.end());
        return result;
    });
}

NumbersGradient Ndf::numbers_gradient(bool precise) const {
    return checked([&] {
        rust::Box<sgtd::NumbersTable> core = sgtd::new_numbers_table(*m_impl->core, precise);
        sgtd::NumbersHeader header         = core->numbers_header();
        rust::Slice<const float> flat      = core->flat();
        NumbersGradient result;
        result.columns       = header.columns;
        result.cells_of_h    = header.cells_of_h;
        result.cells_of_f    = header.cells_of_f;
        result.first         = header.first;
        result.first_precise = header.first_precise;
        result.matrix.assign(flat.begin(), flat.end());
        return result;
    });
}

size_t Ndf::count_of_numbers() const { return m_impl->core->count_of_numbers(); }

void Ndf::by_numbers(std::string_view quantity, double alpha_u, double alpha_v, In w,
                     Out out) const {
    checked([&] {
        m_impl->core->by_numbers(to_core(quantity), alpha_u, alpha_v, to_core(w), to_core(out));
    });
}

double Ndf::d(double alpha_u, double alpha_v, const Vec3 &m) const {
    return m_impl->core->d(alpha_u, alpha_v, to_core(m));
}

double Ndf::projected_area(double alpha_u, double alpha_v, const Vec3 &w) const {
    return m_impl->core->projected_area(alpha_u, alpha_v, to_core(w));
}

double Ndf::pdf(double alpha_u, double alpha_v, const Vec3 &wi, const Vec3 &m,
                Normals normals) const {
    return m_impl->core->pdf(alpha_u, alpha_v, to_core(wi), to_core(m), to_core(normals));
}

NormalSample Ndf::sample(double alpha_u, double alpha_v, const Vec3 &wi, double u1, double u2,
                         Normals normals) const {
    return from_core(m_impl->core->sample(alpha_u, alpha_v, to_core(wi), u1, u2, to_core(normals)));
}

Reflected Ndf::reflected(const Reflection &view, const Vec3 &wo) const {
    return from_core(m_impl->core->reflected(to_core(view), to_core(wo)));
}

ReflectionSample Ndf::sample_reflection(const Reflection &view, double u1, double u2) const {
    return from_core(m_impl->core->sample_reflection(to_core(view), u1, u2));
}

std::pair<Reflected, ReflectionSample>
Ndf::reflected_and_sample(const Reflection &view, const Vec3 &wo, double u1, double u2) const {
    sgtd::ReflectedAndSample both =
        m_impl->core->reflected_and_sample(to_core(view), to_core(wo), u1, u2);
    return { from_core(both.reflected), from_core(both.sample) };
}

size_t Ndf::results_of(std::string_view query, size_t numbers) {
    return checked([&] { return sgtd::results_of(to_core(query), numbers); });
}

void Ndf::eval(std::string_view query, double alpha_u, double alpha_v, In first, In second,
               Out out) const {
    checked([&] {
        m_impl->core->eval_batch(to_core(query), alpha_u, alpha_v, to_core(first), to_core(second),
                                 to_core(out));
    });
}

struct Watch::Impl {
    rust::Box<sgtd::Watch> core;
};

Watch::Watch() : m_impl(new Impl{ sgtd::new_watch() }) {}
Watch::~Watch() = default;
uint64_t Watch::done() const { return m_impl->core->done(); }
double Watch::distance() const { return m_impl->core->distance(); }
void Watch::stop() const { m_impl->core->stop(); }

static sgtd::Goniometer to_core(const Goniometer &goniometer) {
    auto material = goniometer.material == FacetMaterial::Conductor ? sgtd::FacetMaterial::Conductor
                    : goniometer.material == FacetMaterial::Dielectric
                        ? sgtd::FacetMaterial::Dielectric
                        : sgtd::FacetMaterial::Mirror;
    return { to_core(goniometer.wi), material,         goniometer.eta,      goniometer.k,
             goniometer.orders,      goniometer.polar, goniometer.azimuths, goniometer.cosines,
             goniometer.walks,       goniometer.seed };
}

size_t Goniometer::numbers() const {
    return checked([&] { return sgtd::count_numbers(to_core(*this)); });
}

void Goniometer::reflectance(Slice<const double> incident, Slice<double> out) const {
    checked([&] { sgtd::facet_reflectance(to_core(*this), to_core(incident), to_core(out)); });
}

SlopeAgreement Ndf::slope_agreement(double alpha_u, double alpha_v, In slopes) const {
    return checked([&] {
        auto found = sgtd::slope_agreement(*m_impl->core, alpha_u, alpha_v, to_core(slopes));
        return SlopeAgreement{ found.ks, found.tv, found.tv_independent, found.worst_bin,
                               found.mean_error };
    });
}

void Ndf::measure_model(double alpha_u, double alpha_v, const Goniometer &goniometer,
                        const Watch &watch, Out out) const {
    checked([&] {
        sgtd::measure_model(*m_impl->core, alpha_u, alpha_v, to_core(goniometer),
                            *watch.m_impl->core, to_core(out));
    });
}

struct Microsurface::Impl {
    rust::Box<sgtd::Microsurface> core;
};

Microsurface::Microsurface(std::unique_ptr<Impl> impl) : m_impl(std::move(impl)) {}
Microsurface::Microsurface(Microsurface &&other) noexcept = default;
Microsurface::~Microsurface()                             = default;

Microsurface Microsurface::generate(const Ndf &ndf, size_t size, double correlation, uint64_t seed,
                                    double tolerance, size_t steps, const Watch &watch) {
    return checked([&] {
        sgtd::SurfaceSettings settings{ size, correlation, seed, tolerance, steps };
        return Microsurface(std::unique_ptr<Impl>(
            new Impl{ sgtd::generate_surface(*ndf.m_impl->core, settings, *watch.m_impl->core) }));
    });
}

Microsurface::Microsurface(size_t nx, size_t ny, double dx, double dy, Slice<const double> heights)
    : m_impl(checked([&] {
          return std::unique_ptr<Impl>(
              new Impl{ sgtd::surface_of_heights(nx, ny, dx, dy, to_core(heights)) });
      })) {}

Slice<const double> Microsurface::heights() const {
    auto heights = m_impl->core->heights();
    return { heights.data(), heights.size() };
}

std::vector<double> Microsurface::slopes() const {
    auto slopes = m_impl->core->slopes();
    return { slopes.begin(), slopes.end() };
}

void Microsurface::projected_areas(Slice<const double> w, Slice<double> out) const {
    checked([&] { m_impl->core->projected_areas(to_core(w), to_core(out)); });
}

std::vector<double> Microsurface::areas_by_cosine(const Goniometer &goniometer) const {
    return checked([&] {
        auto areas = m_impl->core->areas_by_cosine(to_core(goniometer));
        return std::vector<double>(areas.begin(), areas.end());
    });
}

void Microsurface::measure(const Goniometer &goniometer, const Watch &watch,
                           Slice<double> out) const {
    checked([&] { m_impl->core->measure(to_core(goniometer), *watch.m_impl->core, to_core(out)); });
}

} // namespace sgtd::host
