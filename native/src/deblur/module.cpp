// Python interface of deconvolution, used by omnimirror.dewarp.restoration._deconvolution.

#include <algorithm>
#include <memory>

#include "bindings.hpp"
#include "deblur.hpp"

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
            "firsts must begin with 0 and end with the number of weights");
    // Check all of firsts before use: a value that is too large would otherwise be used before the next one reveals it.
    for (size_t i = 0; i + 1 < count; ++i) require(first[i] <= first[i + 1], "firsts must not decrease");
    k.reach = 1;
    for (size_t kernel = 0; kernel + 1 < count; ++kernel) {
        k.first_taps.push_back(static_cast<int32_t>(k.taps.size()));
        for (int32_t i = first[kernel]; i < first[kernel + 1]; ++i) {
            const Tap tap{checked(offset[2 * i], "offsets", -MAX_OFFSET, MAX_OFFSET),
                          checked(offset[2 * i + 1], "offsets", -MAX_OFFSET, MAX_OFFSET), weight[i]};
            for (const int32_t along : {tap.down, tap.right})
                k.reach = std::max(k.reach, along < 0 ? (k.fineness - 1 - along) / k.fineness : along / k.fineness);
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
    for (const int32_t which : k.kernels) require(which >= -1 && which < count, "kernels must exist, or be -1");
    k.known.resize(static_cast<size_t>(k.width) * static_cast<size_t>(k.height));
    const int32_t* known = checked(pixels, "pixels", {ANY});
    for (size_t i = 0; i < pixels.shape(0); ++i) {
        const int32_t pixel = checked(known[i], "pixels", 0, k.width * k.height - 1);
        const int block = pixel / k.width * blocks + pixel % k.width / k.block;
        require(k.kernels[static_cast<size_t>(block)] >= 0, "every known pixel must have a kernel");
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
        const Box kept{n[0], n[1], n[2], n[3]}, seen{n[4], n[5], n[6], n[7]};
        for (const Box& box : {kept, seen})
            require(0 <= box.top && box.top < box.bottom && box.bottom <= k.height && 0 <= box.left &&
                        box.left < box.right && box.right <= k.width,
                    "tiles must lie in the picture");
        require(seen.left % GROUP == 0, "explained parts of tiles must begin with a group of 8 pixels");
        const Box values{std::max(seen.top - reach, 0), std::min(seen.bottom + reach, k.height),
                         std::max(seen.left - groups, 0), std::min(seen.right + groups, k.width)};
        k.tiles.push_back({kept, seen, values});
    }
}

BlurKernels* make_kernels(int width, int height, int fineness, const Ints& firsts, const Ints& offsets,
                          const Floats& weights, const Ints& pixels, int block, const Ints& kernels,
                          const Ints& tiles, const Floats& concentration) {
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

void start(Sharpening* sharp, const BlurKernels& k, const Floats& roots, const Floats& guess) {
    const int64_t channels = length_of(roots, 2);
    const float* root = checked(roots, "roots", {k.height, k.width, channels == 1 ? 1 : 3});
    const float* first = checked(guess, "guess", {k.height, k.width, channels});
    nb::gil_scoped_release released;
    new (sharp) Sharpening(k, static_cast<int>(channels), root, first);
}

void improve_sharp(Sharpening& s, const Floats& costs, const Ints& steps) {
    const float* cost = checked(costs, "costs", {s.blur.height, s.blur.width});
    const int32_t* step = checked(steps, "steps", {static_cast<int64_t>(s.blur.tiles.size())});
    for (size_t i = 0; i < s.blur.tiles.size(); ++i) checked(step[i], "steps", INT32_MIN, MAX_STEPS);
    nb::gil_scoped_release released;
    sharpening_kernel().improve(s, cost, step);
}

void log_steepness_of(const Sharpening& s, const FloatsOut& logarithms) {
    float* out = checked(logarithms, "logarithms", {s.blur.height, s.blur.width});
    nb::gil_scoped_release released;
    sharpening_kernel().log_steepness(s, out);
}

void blurred_of(Sharpening& s, const FloatsOut& light) {
    float* out = checked(light, "light", {s.blur.height, s.blur.width, s.channels});
    nb::gil_scoped_release released;
    sharpening_kernel().blurred(s, out);
}

void light_of(const Sharpening& s, const FloatsOut& light) {
    float* out = checked(light, "light", {s.blur.height, s.blur.width, s.channels});
    nb::gil_scoped_release released;
    sharpening_kernel().light(s, out);
}

}  // namespace

void add_deblurring(nb::module_& m) {
    nb::class_<BlurKernels>(m, "BlurKernels")
        .def(nb::new_(&make_kernels), "width"_a, "height"_a, "fineness"_a, "firsts"_a, "offsets"_a, "weights"_a,
             "pixels"_a, "block"_a, "kernels"_a, "tiles"_a, "concentration"_a);
    nb::class_<Sharpening>(m, "Sharpening")
        .def("__init__", &start, "kernels"_a, "roots"_a, "guess"_a, nb::keep_alive<1, 2>())
        .def("improve", &improve_sharp, "costs"_a, "steps"_a)
        .def("log_steepness", &log_steepness_of, "logarithms"_a)
        .def("blurred", &blurred_of, "light"_a)
        .def("light", &light_of, "light"_a);
}

}  // namespace omnimirror
