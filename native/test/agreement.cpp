// Comparison of all vector kernels that the machine supports with the plain ones, without Python: for cross-compiled
// builds under an emulator, and for the sanitizers. Buffers are allocated exactly, so that accesses outside them are
// detected.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "kernel_jobs.hpp"
#include "pool.hpp"
#include "sampling/packed.hpp"

using namespace omnimirror;

namespace {

struct Case {
    int width, height, columns, rows, channels;
    Depth depth;
    Interpolation interpolation;
    int gap;             // pixels between the rows of the source
    bool is_averaged;  // over footprints, with cubic interpolation
};

// Coordinates computed with other instruction sets differ in their last bits, and so do the samples. In rare cases,
// rounding changes which pixel is the nearest, or whether a position is inside the image.
struct Difference {
    double max_deviation = 0;  // in units of the tolerance, of values that do not jump
    long count = 0, jump_count = 0, of = 0,
         nan_count = 0;  // numbers of values that differ, that jump, of all values, and of NaN

    void add(const Difference& other) {
        max_deviation = std::max(max_deviation, other.max_deviation);
        count += other.count, jump_count += other.jump_count, of += other.of, nan_count += other.nan_count;
    }
};

constexpr double MAX_JUMP_FRACTION = 1e-3;  // maximum share of values that jump

float smaller_side(const Case& c) { return static_cast<float>(std::min(c.width, c.height)); }

// All kinds of values that a coordinate may have; most of them are inside the image.
float value_or_special(float ordinary, std::mt19937& random) {
    static const float special[] = {NAN, INFINITY, -INFINITY, 1e30f, -1e30f, -0.5f, -0.50001f, 0.0f, 2147483648.0f};
    return random() % 16 ? ordinary : special[random() % 9];
}

// Memory of a case; each array is allocated exactly.
struct Memory {
    std::unique_ptr<uint8_t[]> source, taps;
    std::unique_ptr<float[]> coordinates, radii, cosines, sines;
    std::vector<float> x, y, weights, patches;  // of nodes, with the readable values after their ends
    std::vector<int32_t> cells, states;
};

std::unique_ptr<uint8_t[]> image_of(const Case& c, size_t stride, std::mt19937& random) {
    const size_t pixel = static_cast<size_t>(c.channels * size_of(c.depth));
    const size_t bytes = stride * static_cast<size_t>(c.height - 1) + pixel * static_cast<size_t>(c.width);
    std::unique_ptr<uint8_t[]> source(new uint8_t[bytes]);
    for (size_t i = 0; i < bytes; ++i) source[i] = static_cast<uint8_t>(random());
    if (c.depth == Depth::f32)
        for (size_t i = 0; i + 4 <= bytes; i += 4) {
            const float value = static_cast<float>(random() % 1000) / 1000;
            std::memcpy(source.get() + i, &value, 4);
        }
    return source;
}

Coordinates coordinates_of(const Case& c, Memory& m, std::mt19937& random) {
    const size_t places = static_cast<size_t>(c.columns) * static_cast<size_t>(c.rows);
    m.coordinates.reset(new float[2 * places]);
    std::uniform_real_distribution<float> x(-1, static_cast<float>(c.width)), y(-1, static_cast<float>(c.height));
    for (size_t i = 0; i < places; ++i) {
        m.coordinates[2 * i] = value_or_special(x(random), random);
        m.coordinates[2 * i + 1] = value_or_special(y(random), random);
    }
    return {reinterpret_cast<const uint8_t*>(m.coordinates.get()), 8 * c.columns, false};
}

// Circles, most of them inside the image, for which there are dedicated kernels.
Polar polar_of(const Case& c, Memory& m, std::mt19937& random) {
    const size_t columns = static_cast<size_t>(c.columns), rows = static_cast<size_t>(c.rows);
    m.radii.reset(new float[rows]);
    m.cosines.reset(new float[columns + PADDING]()), m.sines.reset(new float[columns + PADDING]());
    const float reach = 0.55f * static_cast<float>(c.width < c.height ? c.width : c.height);
    for (size_t i = 0; i < rows; ++i) m.radii[i] = reach * static_cast<float>(random() % 1000) / 1000;
    for (size_t i = 0; i < columns; ++i) {
        const float angle = static_cast<float>(random() % 10000);
        m.cosines[i] = std::cos(angle), m.sines[i] = std::sin(angle);
    }
    const float x = static_cast<float>(c.width - 1) / 2, y = static_cast<float>(c.height - 1) / 2;
    return {m.radii.get(), m.cosines.get(), m.sines.get(), x, y, 1};
}

// A smooth lattice, most of it inside the image. Some cells have patches, whose coordinates may be of any kind; some
// nodes are NaN.
Lattice lattice_of(const Case& c, const Geometry& g, int step, Memory& m, std::mt19937& random) {
    const int rows = (c.rows + step - 1) / step, columns = (c.columns + step - 1) / step;
    const size_t count = static_cast<size_t>(rows + 3) * static_cast<size_t>(columns + 3);
    const float wide = static_cast<float>(c.width), high = static_cast<float>(c.height);
    const float inset = random() % 2 ? 0.3f : 0.0f;
    m.x.assign(count + PADDING, 0), m.y = m.x;
    for (size_t i = 0; i < count; ++i) {
        const float u = static_cast<float>(i % static_cast<size_t>(columns + 3)) / static_cast<float>(columns + 2);
        const float v = static_cast<float>(i / static_cast<size_t>(columns + 3)) / static_cast<float>(rows + 2);
        m.x[i] = wide * (inset + (1 - 2 * inset) * u + 0.05f * std::sin(3 * v));
        m.y[i] = high * (inset + (1 - 2 * inset) * v + 0.05f * std::sin(4 * u));
    }
    if (random() % 4 == 0) m.x[random() % count] = NAN;
    m.weights.assign(static_cast<size_t>(4 * step) + PADDING, 0);
    for (int i = 0; i < step; ++i) {
        const float t = static_cast<float>(i) / static_cast<float>(step);
        const float w[4] = {-t * (t - 1) * (t - 2) / 6, (t + 1) * (t - 1) * (t - 2) / 2, -(t + 1) * t * (t - 2) / 2,
                            (t + 1) * t * (t - 1) / 6};
        for (int k = 0; k < 4; ++k) m.weights[static_cast<size_t>(k * step + i)] = w[k];
    }
    m.cells.assign(static_cast<size_t>(rows * columns), INTERPOLATED);
    for (int32_t& cell : m.cells) cell = random() % 8 ? INTERPOLATED : static_cast<int32_t>(random() % 2);
    m.patches.resize(static_cast<size_t>(4 * step * step));
    std::uniform_real_distribution<float> place(-1, smaller_side(c));
    for (float& value : m.patches) value = value_or_special(place(random), random);
    Lattice n{m.x.data(),
              m.y.data(),
              rows + 3,
              columns + 3,
              std::countr_zero(static_cast<unsigned>(step)),
              m.weights.data(),
              m.weights.data(),
              m.cells.data(),
              m.patches.data(),
              columns};
    m.states = states_of(n, g, 1.5625f);
    n.cells = m.states.data();
    return n;
}

Footprints footprints_of(const Case& c, Memory& m, std::mt19937& random, int STEP) {
    const int cell_columns = (c.columns + STEP - 1) / STEP, cell_rows = (c.rows + STEP - 1) / STEP;
    m.taps.reset(new uint8_t[static_cast<size_t>(2 * cell_columns * cell_rows)]);
    for (int i = 0; i < 2 * cell_columns * cell_rows; ++i) m.taps[i] = static_cast<uint8_t>(1 + random() % 4);
    const float x_middle = static_cast<float>(c.width) / 2, y_middle = static_cast<float>(c.height) / 2;
    const float max2 = random() % 2 ? 0.0f : x_middle * x_middle + 4;
    return {m.taps.get(), cell_columns, STEP, random() % 2 ? 1.44f : 0, x_middle, y_middle, 0, max2};
}

std::unique_ptr<uint8_t[]> sample_with(const char* name, Job job, MapType map_type, size_t pixel) {
    const size_t bytes = pixel * static_cast<size_t>(job.target.width) * static_cast<size_t>(job.target.height);
    std::unique_ptr<uint8_t[]> out(new uint8_t[bytes]);
    job.target.data = out.get(), job.map_type = map_type;
    select_kernels(name);
    sample(job);
    return out;
}

// Compare image values, with tolerances of 2 grey levels for 8 bits and 1/2000 of the range otherwise. If coordinates
// are given, no value may jump.
Difference compare(Depth depth, bool is_exact, size_t values, const uint8_t* expected, const uint8_t* results) {
    const double tolerance = depth == Depth::u8 ? 2 : depth == Depth::u16 ? 32 : 5e-4;
    const auto value = [&](const uint8_t* from, size_t i) -> double {
        if (depth == Depth::u8) return from[i];
        uint16_t word;
        float real;
        std::memcpy(&word, from + 2 * i * (depth == Depth::u16), 2);
        std::memcpy(&real, from + 4 * i * (depth == Depth::f32), depth == Depth::f32 ? 4 : 0);
        return depth == Depth::u16 ? static_cast<double>(word) : static_cast<double>(real);
    };
    Difference d;
    d.of = static_cast<long>(values);
    for (size_t i = 0; i < values; ++i) {
        const double deviation = std::fabs(value(results, i) - value(expected, i)) / tolerance;
        d.count += deviation != 0;
        if (deviation <= 1 || is_exact)
            d.max_deviation = std::max(d.max_deviation, deviation);
        else
            ++d.jump_count;
    }
    return d;
}

Difference run(const Case& c, const std::vector<const char*>& names, std::mt19937& random) {
    Memory memory;
    const size_t pixel = static_cast<size_t>(c.channels * size_of(c.depth));
    const size_t stride = pixel * static_cast<size_t>(c.width + c.gap);
    memory.source = image_of(c, stride, random);
    const Image image{memory.source.get(), c.width, c.height, c.channels, static_cast<ptrdiff_t>(stride), c.depth};
    const SourceImage source_image(image, c.interpolation);
    Job job{};
    job.source = source_image.source(), job.interpolation = c.interpolation;
    job.target = {nullptr, c.columns, c.rows, static_cast<ptrdiff_t>(pixel) * c.columns};
    job.coordinates = coordinates_of(c, memory, random), job.polar = polar_of(c, memory, random);
    const int steps[] = {4, 8, 16, 32, 64}, step = steps[random() % 5];
    job.lattice = lattice_of(c, job.source.geometry, step, memory, random);
    const PackedMap map(job.coordinates, c.rows, c.columns, c.width, c.height, c.channels, is_deep(c.depth),
                        c.interpolation);
    const auto blocks = map.blocks_for(job.source.geometry.row_step);
    job.packed = map.packed(*blocks);
    const bool is_averaged = c.is_averaged && c.interpolation == Interpolation::cubic;
    if (is_averaged) job.footprints = footprints_of(c, memory, random, step);
    Difference difference;
    const size_t values = static_cast<size_t>(c.channels) * static_cast<size_t>(c.columns) * static_cast<size_t>(c.rows);
    for (const MapType map_type : {MapType::coordinates, MapType::packed, MapType::polar, MapType::lattice}) {
        if (map_type == MapType::packed && is_averaged && step % 8)
            continue;  // cells of packed maps are multiples of 8
        const auto expected =
            sample_with("plain", job, map_type == MapType::packed ? MapType::coordinates : map_type, pixel);
        for (const char* name : names) {
            const auto out = sample_with(name, job, map_type, pixel);
            const bool is_exact = map_type == MapType::coordinates || map_type == MapType::packed;
            difference.add(compare(c.depth, is_exact && !is_averaged, values, expected.get(), out.get()));
        }
    }
    return difference;
}

// Compare values of other kernels than the samplers.
Difference compare(double tolerance, const Numbers& expected, const Numbers& results) {
    Difference d;
    d.of = static_cast<long>(expected.size());
    if (results.size() != expected.size()) d.max_deviation = INFINITY;
    for (size_t i = 0; i < std::min(expected.size(), results.size()); ++i) {
        const double a = expected[i], b = results[i];
        d.nan_count += std::isnan(a);
        if (a == b || (std::isnan(a) && std::isnan(b))) continue;
        const double deviation = std::fabs(a - b) / (1 + std::fabs(a)) / tolerance;
        ++d.count;
        if (deviation <= 1)
            d.max_deviation = std::max(d.max_deviation, deviation);
        else
            ++d.jump_count;  // also NaN
    }
    return d;
}

bool report(const char* what, const Difference& d) {
    const bool agrees = d.max_deviation <= 1 &&
                        static_cast<double>(d.jump_count) <= MAX_JUMP_FRACTION * static_cast<double>(d.of) &&
                        2 * d.nan_count <= d.of;
    std::printf("%-12s %9ld values, %8ld differ, by at most %.2g of the tolerance; %ld jump, %ld are NaN%s\n", what,
                d.of, d.count, d.max_deviation, d.jump_count, d.nan_count, agrees ? "" : ": TOO MANY");
    return agrees;
}

}  // namespace

int main(int argc, char** argv) {
    const int cases = argc > 1 ? std::atoi(argv[1]) : 3000;
    std::mt19937 random(1);
    const int channels[] = {1, 2, 3, 4};
    std::vector<const char*> names;
    for (const char* name : {"avx2", "avx512", "avx512-gather", "neon"})
        if (select_kernels(name)) names.push_back(name);
    for (const char* name : names) std::printf("%s ", name);
    std::printf("against plain:\n");
    bool agrees = true;
    Difference images[3];
    for (int i = 0; i < cases; ++i) {
        const auto side = [&] { return static_cast<int>(random() % 4 ? 1 + random() % 40 : 1 + random() % 200); };
        const Case c{side(),
                     side(),
                     side(),
                     side(),
                     channels[random() % 4],
                     static_cast<Depth>(random() % 3),
                     static_cast<Interpolation>(random() % 3),
                     static_cast<int>(random() % 3),
                     random() % 2 == 0};
        set_threads(1 + static_cast<int>(random() % 4));
        images[static_cast<size_t>(c.depth)].add(run(c, names, random));
    }
    const char* const depths[] = {"uint8", "uint16", "float32"};
    for (size_t i = 0; i < 3; ++i) agrees &= report(depths[i], images[i]);

    for (const auto make : {projection, designs, reflections, trials, exposures, deblurring}) {
        std::map<std::string, Difference> differences;
        for (int i = 0; i < 1 + cases / 30; ++i) {
            set_threads(1 + static_cast<int>(random() % 4));
            const OtherJob job = make(random);
            select_kernels("plain");
            const Numbers expected = job.compute();
            for (const char* name : names) {
                select_kernels(name);
                differences[job.name].add(compare(job.tolerance, expected, job.compute()));
            }
        }
        for (const auto& [name, difference] : differences) agrees &= report(name.c_str(), difference);
    }
    return !agrees;
}
