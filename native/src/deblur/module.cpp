// The part of omnimirror._native that omnimirror.simulate.restoration.sharp_picture calls.

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
            if (adjoins) {
                ++k.runs.back().count;
            } else {
                k.weights.resize((k.weights.size() + RUN_LANES - 1) / RUN_LANES * RUN_LANES);
                require(k.weights.size() < (1u << 30), "there are too many weights");
                k.runs.push_back({down, right, 1, static_cast<int32_t>(k.weights.size())});
            }
            k.weights.push_back(weights.data()[i]);
            k.least_down = std::min(k.least_down, down), k.most_down = std::max(k.most_down, down);
            k.least_right = std::min(k.least_right, right), k.most_right = std::max(k.most_right, right);
        }
    }
    k.first_runs.push_back(static_cast<int32_t>(k.runs.size()));
    k.weights.resize((k.weights.size() + RUN_LANES - 1) / RUN_LANES * RUN_LANES);
}

void add_pixels(BlurKernels& k, const Ints& pixels, const Ints& kernels) {
    const auto count = static_cast<int32_t>(k.first_runs.size()) - 1;
    int32_t before = -1;
    for (size_t i = 0; i < pixels.size(); ++i) {
        const int32_t pixel = pixels.data()[i], kernel = kernels.data()[i];
        require(pixel > before && pixel < k.width * k.height, "pixels ascend and lie in the picture");
        require(kernel >= 0 && kernel < count, "there is no such kernel");
        before = pixel;
    }
    arrange(k, pixels.data(), kernels.data(), static_cast<int64_t>(pixels.size()));
}

BlurKernels* make_kernels(int width, int height, int fineness, const Ints& firsts, const Ints& offsets,
                          const Floats& weights, const Ints& pixels, const Ints& kernels, const Ints& spans) {
    require(width > 0 && height > 0 && width <= (1 << 14) && height <= (1 << 14), "valid are sides up to 16384");
    require(fineness >= 1 && fineness <= 4, "the fineness is 1 to 4");
    require(firsts.size() >= 1 && offsets.size() == 2 * weights.size() && weights.size() < (1u << 30),
            "offsets are (weights, 2)");
    require(pixels.size() == kernels.size(), "every pixel has a kernel");
    auto k = std::make_unique<BlurKernels>();
    k->width = width, k->height = height, k->fineness = fineness;
    add_runs(*k, firsts, offsets, weights);
    add_pixels(*k, pixels, kernels);
    require(spans.size() == 2 * static_cast<size_t>(k->deep()), "every row of the fine grid has a span");
    for (size_t row = 0; row < spans.size() / 2; ++row) {
        const Span span{spans.data()[2 * row], spans.data()[2 * row + 1]};
        require(0 <= span.begin && span.begin <= span.end && span.end <= k->across(), "a span leaves the picture");
        k->spans.push_back(span);
    }
    return k.release();
}

void start(Sharpening* sharp, const BlurKernels& k, const Floats& roots) {
    require(roots.ndim() == 3 && roots.shape(0) == static_cast<size_t>(k.height) &&
                roots.shape(1) == static_cast<size_t>(k.width) && (roots.shape(2) == 1 || roots.shape(2) == 3),
            "roots are (height, width, 1 or 3)");
    nb::gil_scoped_release released;
    new (sharp) Sharpening(k, static_cast<int>(roots.shape(2)), roots.data());
}

template <class A>
void require_pixels(const Sharpening& s, const A& array) {
    require(array.ndim() == 2 && array.shape(0) == static_cast<size_t>(s.blur.height) &&
                array.shape(1) == static_cast<size_t>(s.blur.width),
            "values are (height, width)");
}

void improve_sharp(Sharpening& s, const Floats& costs, int steps) {
    require_pixels(s, costs);
    require(steps >= 1, "there is a step at least");
    nb::gil_scoped_release released;
    sharpening_kernel().improve(s, costs.data(), steps);
}

void log_steepness_of(const Sharpening& s, const FloatsOut& logarithms) {
    require_pixels(s, logarithms);
    nb::gil_scoped_release released;
    sharpening_kernel().log_steepness(s, logarithms.data());
}

void blurred_of(Sharpening& s, const FloatsOut& light) {
    require(light.ndim() == 2 && light.shape(0) == s.blur.visits.size() &&
                light.shape(1) == static_cast<size_t>(s.channels),
            "values are (pixels, channels)");
    nb::gil_scoped_release released;
    sharpening_kernel().blurred(s, light.data());
}

void light_of(const Sharpening& s, const FloatsOut& light) {
    require(light.ndim() == 3 && light.shape(0) == static_cast<size_t>(s.blur.height) &&
                light.shape(1) == static_cast<size_t>(s.blur.width) &&
                light.shape(2) == static_cast<size_t>(s.channels),
            "values are (height, width, channels)");
    nb::gil_scoped_release released;
    sharpening_kernel().light(s, light.data());
}

}  // namespace

void add_deblurring(nb::module_& m) {
    nb::class_<BlurKernels>(m, "BlurKernels")
        .def(nb::new_(&make_kernels), "width"_a, "height"_a, "fineness"_a, "firsts"_a, "offsets"_a, "weights"_a,
             "pixels"_a, "kernels"_a, "spans"_a);
    nb::class_<Sharpening>(m, "Sharpening")
        .def("__init__", &start, "kernels"_a, "roots"_a, nb::keep_alive<1, 2>())
        .def("improve", &improve_sharp, "costs"_a, "steps"_a)
        .def("log_steepness", &log_steepness_of, "logarithms"_a)
        .def("blurred", &blurred_of, "light"_a)
        .def("light", &light_of, "light"_a);
}

}  // namespace omnimirror
