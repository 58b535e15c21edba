// Python interface of deconvolution, used by omnimirror.dewarp.restoration._deconvolution.

#include <algorithm>
#include <memory>

#include "bindings.hpp"
#include "deconvolution.hpp"

namespace omnimirror {
namespace {

constexpr int MAX_OFFSET = (1 << 12) - 1, MAX_SIDE = 1 << 14, MAX_STEPS = 1 << 14;

// The taps of each kernel: offsets (n, 2) down and right, and weights (n,).
void add_taps(BlurKernels& k, const Ints& firsts, const Ints& offsets, const Floats& weights) {
    const float* weight = checked(weights, "weights", {ANY});
    const int values = count_of(weights.shape(0), "weights");
    const int32_t* offset = checked(offsets, "offsets", {values, 2});
    const int32_t* first = checked(firsts, "firsts", {ANY});
    const size_t count = firsts.shape(0);
    require(count > 0 && first[0] == 0 && first[count - 1] == values,
            "firsts must start with 0 and end with the number of weights");
    // Check all of firsts before use: a value that is too large would otherwise be used before the next one reveals it.
    for (size_t i = 0; i + 1 < count; ++i) require(first[i] <= first[i + 1], "firsts must be in ascending order");
    k.reach = 1;
    for (size_t kernel = 0; kernel + 1 < count; ++kernel) {
        k.first_taps.push_back(static_cast<int32_t>(k.taps.size()));
        for (int32_t i = first[kernel]; i < first[kernel + 1]; ++i) {
            const Tap tap{checked(offset[2 * i], "offsets", -MAX_OFFSET, MAX_OFFSET),
                          checked(offset[2 * i + 1], "offsets", -MAX_OFFSET, MAX_OFFSET), weight[i]};
            for (const int32_t along : {tap.down, tap.right})
                k.reach = std::max(k.reach,
                                   along < 0 ? (k.fineness - 1 - along) / k.fineness : along / k.fineness);
            k.taps.push_back(tap);
        }
        if (k.taps.size() % 2) k.taps.push_back({0, 0, 0});
    }
    k.first_taps.push_back(static_cast<int32_t>(k.taps.size()));
}

void add_pixels(BlurKernels& k, const Ints& pixels, const Ints& kernels) {
    const auto count = static_cast<int32_t>(k.first_taps.size()) - 1;
    const int blocks = k.groups() * GROUP / k.block;
    const int32_t* kernel = checked(kernels, "kernels", {k.height, blocks});
    k.kernels.assign(kernel, kernel + kernels.size());
    for (const int32_t which : k.kernels)
        require(which >= -1 && which < count, "kernels must be -1 or less than the number of kernels");
    k.known.resize(static_cast<size_t>(k.width) * static_cast<size_t>(k.height));
    const int32_t* known = checked(pixels, "pixels", {ANY});
    for (size_t i = 0; i < pixels.shape(0); ++i) {
        const int32_t pixel = checked(known[i], "pixels", 0, k.width * k.height - 1);
        const int block = pixel / k.width * blocks + pixel % k.width / k.block;
        require(k.kernels[static_cast<size_t>(block)] >= 0, "kernels must contain a kernel for each pixel of pixels");
        k.known[static_cast<size_t>(pixel)] = 1;
    }
}

void add_concentration(BlurKernels& k, const Floats& concentration) {
    const float* first = checked(concentration, "concentration", {k.height, k.width});
    k.concentration.assign(first, first + concentration.size());
}

void add_tiles(BlurKernels& k, const Ints& tiles) {
    const int32_t* n = checked(tiles, "tiles", {ANY, 2, 4});
    const int count = count_of(tiles.shape(0), "tiles");
    const int reach = k.reach, groups = (reach + GROUP - 1) / GROUP * GROUP;
    for (int i = 0; i < count; ++i, n += 8) {
        const Box core{n[0], n[1], n[2], n[3]}, modelled{n[4], n[5], n[6], n[7]};
        for (const Box& box : {core, modelled})
            require(0 <= box.top && box.top < box.bottom && box.bottom <= k.height && 0 <= box.left &&
                        box.left < box.right && box.right <= k.width,
                    "tiles must be inside the image");
        require(modelled.left % GROUP == 0, "the left side of the second box of a tile must be a multiple of 8");
        const Box values{std::max(modelled.top - reach, 0), std::min(modelled.bottom + reach, k.height),
                         std::max(modelled.left - groups, 0), std::min(modelled.right + groups, k.width)};
        k.tiles.push_back({core, modelled, values});
    }
}

BlurKernels* make_kernels(int width, int height, int fineness, const Ints& firsts, const Ints& offsets,
                          const Floats& weights, const Ints& pixels, int block, const Ints& kernels, const Ints& tiles,
                          const Floats& concentration) {
    require(block == 1 || block == 2 || block == 4 || block == GROUP, "block must be 1, 2, 4 or 8 pixels");
    auto k = std::make_unique<BlurKernels>();
    k->width = checked(width, "width", 1, MAX_SIDE), k->height = checked(height, "height", 1, MAX_SIDE);
    k->fineness = checked(fineness, "fineness", 1, 4), k->block = block;
    add_taps(*k, firsts, offsets, weights);
    add_pixels(*k, pixels, kernels);
    add_tiles(*k, tiles);
    add_concentration(*k, concentration);
    return k.release();
}

void make_deconvolution(Deconvolution* deconvolution, const BlurKernels& k, const Floats& roots, const Floats& guess) {
    const int64_t channels = length_of(roots, 2);
    const float* root = checked(roots, "roots", {k.height, k.width, channels == 1 ? 1 : 3});
    const float* first = checked(guess, "guess", {k.height, k.width, channels});
    nb::gil_scoped_release released;
    new (deconvolution) Deconvolution(k, static_cast<int>(channels), root, first);
}

void improve_binding(Deconvolution& s, const Floats& costs, const Ints& steps) {
    const float* cost = checked(costs, "costs", {s.blur.height, s.blur.width});
    const int32_t* step = checked(steps, "steps", {static_cast<int64_t>(s.blur.tiles.size())});
    for (size_t i = 0; i < s.blur.tiles.size(); ++i) checked(step[i], "steps", INT32_MIN, MAX_STEPS);
    nb::gil_scoped_release released;
    deconvolution_kernel().improve(s, cost, step);
}

void log_steepness_binding(const Deconvolution& s, const FloatsOut& logarithms) {
    float* out = checked(logarithms, "logarithms", {s.blur.height, s.blur.width});
    nb::gil_scoped_release released;
    deconvolution_kernel().log_steepness(s, out);
}

void blurred_binding(Deconvolution& s, const FloatsOut& light) {
    float* out = checked(light, "light", {s.blur.height, s.blur.width, s.channels});
    nb::gil_scoped_release released;
    deconvolution_kernel().blurred(s, out);
}

void light_binding(const Deconvolution& s, const FloatsOut& light) {
    float* out = checked(light, "light", {s.blur.height, s.blur.width, s.channels});
    nb::gil_scoped_release released;
    deconvolution_kernel().light(s, out);
}

}  // namespace

void add_deconvolution(nb::module_& m) {
    nb::class_<BlurKernels>(m, "BlurKernels")
        .def(nb::new_(&make_kernels), "width"_a, "height"_a, "fineness"_a, "firsts"_a, "offsets"_a, "weights"_a,
             "pixels"_a, "block"_a, "kernels"_a, "tiles"_a, "concentration"_a);
    nb::class_<Deconvolution>(m, "Deconvolution")
        .def("__init__", &make_deconvolution, "kernels"_a, "roots"_a, "guess"_a, nb::keep_alive<1, 2>())
        .def("improve", &improve_binding, "costs"_a, "steps"_a)
        .def("log_steepness", &log_steepness_binding, "logarithms"_a)
        .def("blurred", &blurred_binding, "light"_a)
        .def("light", &light_binding, "light"_a);
}

}  // namespace omnimirror
