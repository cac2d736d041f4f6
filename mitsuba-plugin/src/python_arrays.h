#pragma once

#include <algorithm>
#include <memory>
#include <vector>

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include "bridge.h"

/// What the files of `sgtd._core` share: flat arrays of float64 in and out.
namespace sgtd::python {

namespace nb = nanobind;

/// C-contiguous float64 of any shape; the number of values is what counts here.
using Array = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;

using Flat = nb::ndarray<nb::numpy, double, nb::ndim<1>>;

inline host::Slice<const double> in(const Array &array) { return { array.data(), array.size() }; }

/// A new flat array, to be filled without the interpreter lock.
class Output {
public:
    explicit Output(size_t size) : m_data(new double[size]), m_size(size) {}

    explicit Output(const std::vector<double> &values) : Output(values.size()) {
        std::copy(values.begin(), values.end(), m_data.get());
    }

    host::Slice<double> out() { return { m_data.get(), m_size }; }

    Flat release() {
        double *data = m_data.release();
        nb::capsule owner(data, [](void *p) noexcept { delete[] static_cast<double *>(p); });
        return Flat(data, { m_size }, owner);
    }

private:
    std::unique_ptr<double[]> m_data;
    size_t m_size;
};

/// Explicit surfaces: `python_microsurface.cpp`.
void add_microsurface(nb::module_ &m);

} // namespace sgtd::python
