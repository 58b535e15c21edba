// The part of omnimirror._native that omnimirror.simulate.restoration.sharp_picture calls.

#include <algorithm>
#include <memory>

#include "bindings.hpp"
#include "deblur.hpp"

namespace omnimirror {
namespace {

// Kernels of (values) offsets and weights each.
void add_taps(BlurKernels& k, const Ints& firsts, const Ints& offsets, const Floats& weights) {
    const int32_t* first = firsts.data();
    require(first[0] == 0 && first[firsts.size() - 1] == static_cast<int32_t>(weights.size()),
            "kernels begin at the first weight and end with the last");
    k.reach = 1;
    for (size_t kernel = 0; kernel + 1 < firsts.size(); ++kernel) {
        require(first[kernel] <= first[kernel + 1], "kernels follow each other");
        k.first_taps.push_back(static_cast<int32_t>(k.taps.size()));
        for (int32_t i = first[kernel]; i < first[kernel + 1]; ++i) {
            const Tap tap{offsets.data()[2 * i], offsets.data()[2 * i + 1], weights.data()[i]};
            require(std::abs(tap.down) < (1 << 12) && std::abs(tap.right) < (1 << 12), "a kernel reaches too far");
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
    require(kernels.ndim() == 2 && kernels.shape(0) == static_cast<size_t>(k.height) &&
                kernels.shape(1) == static_cast<size_t>(k.groups() * GROUP / k.block),
            "every block of pixels has a kernel, or none");
    k.kernels.assign(kernels.data(), kernels.data() + kernels.size());
    for (const int32_t kernel : k.kernels) require(kernel >= -1 && kernel < count, "there is no such kernel");
    k.known.resize(static_cast<size_t>(k.width) * static_cast<size_t>(k.height));
    for (size_t i = 0; i < pixels.size(); ++i) {
        const int32_t pixel = pixels.data()[i];
        require(pixel >= 0 && pixel < k.width * k.height, "pixels lie in the picture");
        const int block = pixel / k.width * (k.groups() * GROUP / k.block) + pixel % k.width / k.block;
        require(k.kernels[static_cast<size_t>(block)] >= 0, "every known pixel has a kernel");
        k.known[static_cast<size_t>(pixel)] = 1;
    }
}

void add_concentration(BlurKernels& k, const Floats& concentration) {
    require(concentration.ndim() == 2 && concentration.shape(0) == static_cast<size_t>(k.height) &&
                concentration.shape(1) == static_cast<size_t>(k.width),
            "every pixel has a concentration");
    k.concentration.assign(concentration.data(), concentration.data() + concentration.size());
}

void add_tiles(BlurKernels& k, const Ints& tiles) {
    require(tiles.ndim() == 3 && tiles.shape(1) == 2 && tiles.shape(2) == 4, "tiles are (n, 2, 4)");
    const int reach = k.reach, groups = (reach + GROUP - 1) / GROUP * GROUP;
    for (size_t i = 0; i < tiles.shape(0); ++i) {
        const int32_t* n = tiles.data() + 8 * i;
        const Box kept{n[0], n[1], n[2], n[3]}, seen{n[4], n[5], n[6], n[7]};
        for (const Box& box : {kept, seen})
            require(0 <= box.top && box.top < box.bottom && box.bottom <= k.height && 0 <= box.left &&
                        box.left < box.right && box.right <= k.width,
                    "a tile leaves the picture");
        require(seen.left % GROUP == 0, "what tiles explain begins with a group");
        const Box values{std::max(seen.top - reach, 0), std::min(seen.bottom + reach, k.height),
                         std::max(seen.left - groups, 0), std::min(seen.right + groups, k.width)};
        k.tiles.push_back({kept, seen, values});
    }
}

BlurKernels* make_kernels(int width, int height, int fineness, const Ints& firsts, const Ints& offsets,
                          const Floats& weights, const Ints& pixels, int block, const Ints& kernels,
                          const Ints& tiles, const Floats& concentration) {
    require(width > 0 && height > 0 && width <= (1 << 14) && height <= (1 << 14), "valid are sides up to 16384");
    require(fineness >= 1 && fineness <= 4, "the fineness is 1 to 4");
    require(block == 1 || block == 2 || block == 4 || block == GROUP, "blocks have 1, 2, 4 or 8 pixels");
    require(firsts.size() >= 1 && offsets.size() == 2 * weights.size() && weights.size() < (1u << 30),
            "offsets are (weights, 2)");
    auto k = std::make_unique<BlurKernels>();
    k->width = width, k->height = height, k->fineness = fineness, k->block = block;
    add_taps(*k, firsts, offsets, weights);
    add_pixels(*k, pixels, kernels);
    add_tiles(*k, tiles);
    add_concentration(*k, concentration);
    return k.release();
}

void start(Sharpening* sharp, const BlurKernels& k, const Floats& roots, const Floats& guess) {
    for (const Floats* values : {&roots, &guess})
        require(values->ndim() == 3 && values->shape(0) == static_cast<size_t>(k.height) &&
                    values->shape(1) == static_cast<size_t>(k.width) &&
                    (values->shape(2) == 1 || values->shape(2) == 3) && values->shape(2) == roots.shape(2),
                "roots are (height, width, 1 or 3)");
    nb::gil_scoped_release released;
    new (sharp) Sharpening(k, static_cast<int>(roots.shape(2)), roots.data(), guess.data());
}

template <class A>
void require_pixels(const Sharpening& s, const A& array) {
    require(array.ndim() == 2 && array.shape(0) == static_cast<size_t>(s.blur.height) &&
                array.shape(1) == static_cast<size_t>(s.blur.width),
            "values are (height, width)");
}

void require_light(const Sharpening& s, const FloatsOut& light) {
    require(light.ndim() == 3 && light.shape(0) == static_cast<size_t>(s.blur.height) &&
                light.shape(1) == static_cast<size_t>(s.blur.width) &&
                light.shape(2) == static_cast<size_t>(s.channels),
            "values are (height, width, channels)");
}

void improve_sharp(Sharpening& s, const Floats& costs, const Ints& steps) {
    require_pixels(s, costs);
    require(steps.size() == s.blur.tiles.size(), "every tile has its steps");
    nb::gil_scoped_release released;
    sharpening_kernel().improve(s, costs.data(), steps.data());
}

void log_steepness_of(const Sharpening& s, const FloatsOut& logarithms) {
    require_pixels(s, logarithms);
    nb::gil_scoped_release released;
    sharpening_kernel().log_steepness(s, logarithms.data());
}

void blurred_of(Sharpening& s, const FloatsOut& light) {
    require_light(s, light);
    nb::gil_scoped_release released;
    sharpening_kernel().blurred(s, light.data());
}

void light_of(const Sharpening& s, const FloatsOut& light) {
    require_light(s, light);
    nb::gil_scoped_release released;
    sharpening_kernel().light(s, light.data());
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
