// The part of omnimirror._native that omnimirror.simulate.restoration.operators calls.

#include <algorithm>
#include <memory>

#include "bindings.hpp"
#include "deblur.hpp"

namespace omnimirror {
namespace {

// Kernels of (values) offsets and weights each, sorted by rows and columns, as runs of adjoining values.
void add_runs(BlurKernels& k, const Ints& firsts, const Ints& offsets, const Floats& weights) {
    const int32_t* first = firsts.data();
    require(first[0] == 0 && first[firsts.size() - 1] == static_cast<int32_t>(weights.size()),
            "kernels begin at the first weight and end with the last");
    k.least_down = k.least_right = k.most_down = k.most_right = 0;
    for (size_t kernel = 0; kernel + 1 < firsts.size(); ++kernel) {
        require(first[kernel] <= first[kernel + 1], "kernels follow each other");
        k.first_runs.push_back(static_cast<int32_t>(k.runs.size()));
        for (int32_t i = first[kernel]; i < first[kernel + 1]; ++i) {
            const int32_t down = offsets.data()[2 * i], right = offsets.data()[2 * i + 1];
            require(std::abs(down) < (1 << 12) && std::abs(right) < (1 << 12), "a kernel reaches too far");
            const bool adjoins = i > first[kernel] && k.runs.back().down == down &&
                                 k.runs.back().right + k.runs.back().count == right;
            if (adjoins)
                ++k.runs.back().count;
            else
                k.runs.push_back({down, right, 1, i});
            k.least_down = std::min(k.least_down, down), k.most_down = std::max(k.most_down, down);
            k.least_right = std::min(k.least_right, right), k.most_right = std::max(k.most_right, right);
        }
    }
    k.first_runs.push_back(static_cast<int32_t>(k.runs.size()));
}

BlurKernels* make_kernels(int width, int height, int fineness, const Ints& firsts, const Ints& offsets,
                          const Floats& weights, const Ints& pixels, const Ints& kernels) {
    require(width > 0 && height > 0 && width <= (1 << 14) && height <= (1 << 14), "valid are sides up to 16384");
    require(fineness >= 1 && fineness <= 4, "the fineness is 1 to 4");
    require(firsts.size() >= 1 && offsets.size() == 2 * weights.size() && weights.size() < (1u << 30),
            "offsets are (weights, 2)");
    require(pixels.size() == kernels.size(), "every pixel has a kernel");
    auto k = std::make_unique<BlurKernels>();
    k->width = width, k->height = height, k->fineness = fineness;
    add_runs(*k, firsts, offsets, weights);
    k->weights.assign(weights.data(), weights.data() + weights.size());
    k->pixels.assign(pixels.data(), pixels.data() + pixels.size());
    k->kernels.assign(kernels.data(), kernels.data() + kernels.size());
    int32_t before = -1;
    for (size_t i = 0; i < k->pixels.size(); ++i) {
        require(k->pixels[i] > before && k->pixels[i] < width * height, "pixels ascend and lie in the picture");
        require(k->kernels[i] >= 0 && k->kernels[i] + 1 < static_cast<int32_t>(firsts.size()), "there is no such kernel");
        before = k->pixels[i];
    }
    return k.release();
}

template <class A>
int channels_of(const A& array, size_t places) {
    require(array.ndim() == 2 && array.shape(0) == places && (array.shape(1) == 1 || array.shape(1) == 4),
            "values are (places, 1 or 4)");
    return static_cast<int>(array.shape(1));
}

size_t places_of(const BlurKernels& k) {
    return size_t{1} * static_cast<size_t>(k.width) * static_cast<size_t>(k.height) *
           static_cast<size_t>(k.fineness * k.fineness);
}

void blur_values(const BlurKernels& k, const Floats& fine, const FloatsOut& blurred) {
    const int channels = channels_of(fine, places_of(k));
    require(channels_of(blurred, k.pixels.size()) == channels, "the arrays differ in channels");
    nb::gil_scoped_release released;
    blur(k, channels, fine.data(), blurred.data());
}

void spread_values(const BlurKernels& k, const Floats& blurred, const FloatsOut& fine) {
    const int channels = channels_of(fine, places_of(k));
    require(channels_of(blurred, k.pixels.size()) == channels, "the arrays differ in channels");
    nb::gil_scoped_release released;
    spread(k, channels, blurred.data(), fine.data());
}

double curvature_times(const BlurKernels& k, const Floats& fine, const Floats& slope2, const Floats& stiffness,
                       const Floats& d, const FloatsOut& product, const FloatsOut& scratch) {
    const size_t places = places_of(k);
    const int channels = channels_of(fine, places);
    require(channels_of(slope2, k.pixels.size()) == channels && channels_of(d, places) == channels &&
                channels_of(product, places) == channels && channels_of(scratch, k.pixels.size()) == channels,
            "the arrays differ in channels");
    require(stiffness.size() == places, "the stiffness is one of each place");
    nb::gil_scoped_release released;
    return times({k, channels, fine.data(), slope2.data(), stiffness.data()}, d.data(), product.data(), scratch.data());
}

double advance_solution(float step, const Floats& d, const Floats& product, const Floats& scale, const FloatsOut& x,
                        const FloatsOut& residual) {
    const size_t places = scale.size();
    const int channels = channels_of(d, places);
    require(channels_of(product, places) == channels && channels_of(x, places) == channels &&
                channels_of(residual, places) == channels,
            "the arrays differ in channels");
    nb::gil_scoped_release released;
    return advance(static_cast<int64_t>(places), channels, step, d.data(), product.data(), scale.data(), x.data(),
                   residual.data());
}

void turn_direction(float share, const Floats& scale, const Floats& residual, const FloatsOut& d) {
    const size_t places = scale.size();
    const int channels = channels_of(d, places);
    require(channels_of(residual, places) == channels, "the arrays differ in channels");
    nb::gil_scoped_release released;
    turn(static_cast<int64_t>(places), channels, share, scale.data(), residual.data(), d.data());
}

}  // namespace

void add_deblurring(nb::module_& m) {
    nb::class_<BlurKernels>(m, "BlurKernels")
        .def(nb::new_(&make_kernels), "width"_a, "height"_a, "fineness"_a, "firsts"_a, "offsets"_a, "weights"_a,
             "pixels"_a, "kernels"_a)
        .def("blur", &blur_values, "fine"_a, "blurred"_a)
        .def("spread", &spread_values, "blurred"_a, "fine"_a)
        .def("curvature_times", &curvature_times, "fine"_a, "slope2"_a, "stiffness"_a, "d"_a, "product"_a, "scratch"_a);
    m.def("advance_solution", &advance_solution, "step"_a, "d"_a, "product"_a, "scale"_a, "x"_a, "residual"_a);
    m.def("turn_direction", &turn_direction, "share"_a, "scale"_a, "residual"_a, "d"_a);
}

}  // namespace omnimirror
