// All vector kernels that the machine has against the plain ones, without Python: for cross-compiled builds under an
// emulator, and for the sanitizers. Buffers are allocated exactly, so that any access beyond one is seen.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <random>
#include <vector>

#include "pool.hpp"
#include "sampling/packed.hpp"

using namespace omnimirror;

namespace {

struct Case {
    int width, height, columns, rows, channels;
    Depth depth;
    Interpolation interpolation;
    int gap;             // pixels between the rows of the source
    bool is_averaged;  // over footprints, where the interpolation is cubic
};

struct Difference {
    int most = 0;
    long count = 0;
};

// Values of every kind that a coordinate may have, most of them in the picture.
float odd_or(float ordinary, std::mt19937& random) {
    static const float odd[] = {NAN, INFINITY, -INFINITY, 1e30f, -1e30f, -0.5f, -0.50001f, 0.0f, 2147483648.0f};
    return random() % 16 ? ordinary : odd[random() % 9];
}

// Memory of a case, each array allocated exactly.
struct Memory {
    std::unique_ptr<uint8_t[]> source, taps;
    std::unique_ptr<float[]> where, radii, cosines, sines;
};

std::unique_ptr<uint8_t[]> picture_of(const Case& c, size_t stride, std::mt19937& random) {
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
    m.where.reset(new float[2 * places]);
    std::uniform_real_distribution<float> x(-1, static_cast<float>(c.width)), y(-1, static_cast<float>(c.height));
    for (size_t i = 0; i < places; ++i) {
        m.where[2 * i] = odd_or(x(random), random);
        m.where[2 * i + 1] = odd_or(y(random), random);
    }
    return {reinterpret_cast<const uint8_t*>(m.where.get()), 8 * c.columns, false};
}

// Circles, most of them within the picture, where places are found by ways of their own.
Polar circles_of(const Case& c, Memory& m, std::mt19937& random) {
    const size_t columns = static_cast<size_t>(c.columns), rows = static_cast<size_t>(c.rows);
    m.radii.reset(new float[rows]);
    m.cosines.reset(new float[columns + BEYOND]()), m.sines.reset(new float[columns + BEYOND]());
    const float reach = 0.55f * static_cast<float>(c.width < c.height ? c.width : c.height);
    for (size_t i = 0; i < rows; ++i) m.radii[i] = reach * static_cast<float>(random() % 1000) / 1000;
    for (size_t i = 0; i < columns; ++i) {
        const float angle = static_cast<float>(random() % 10000);
        m.cosines[i] = std::cos(angle), m.sines[i] = std::sin(angle);
    }
    const float x = static_cast<float>(c.width - 1) / 2, y = static_cast<float>(c.height - 1) / 2;
    return {m.radii.get(), m.cosines.get(), m.sines.get(), x, y, 1};
}

Footprints footprints_of(const Case& c, Memory& m, std::mt19937& random) {
    constexpr int STEP = 16;
    const int cell_columns = (c.columns + STEP - 1) / STEP, cell_rows = (c.rows + STEP - 1) / STEP;
    m.taps.reset(new uint8_t[static_cast<size_t>(2 * cell_columns * cell_rows)]);
    for (int i = 0; i < 2 * cell_columns * cell_rows; ++i) m.taps[i] = static_cast<uint8_t>(1 + random() % 4);
    const float x_middle = static_cast<float>(c.width) / 2, y_middle = static_cast<float>(c.height) / 2;
    const float most2 = random() % 2 ? 0.0f : x_middle * x_middle + 4;
    return {m.taps.get(), cell_columns, STEP, random() % 2 ? 1.44f : 0, x_middle, y_middle, 0, most2};
}

std::unique_ptr<uint8_t[]> sampled_by(const char* name, Job job, Where where, size_t bytes) {
    std::unique_ptr<uint8_t[]> out(new uint8_t[bytes]);
    job.target.data = out.get(), job.where = where;
    use_kernels(name);
    sample(job);
    return out;
}

Difference run(const Case& c, const std::vector<const char*>& names, std::mt19937& random) {
    Memory memory;
    const size_t pixel = static_cast<size_t>(c.channels * size_of(c.depth));
    const size_t stride = pixel * static_cast<size_t>(c.width + c.gap);
    memory.source = picture_of(c, stride, random);
    const Picture picture{memory.source.get(), c.width, c.height, c.channels, static_cast<ptrdiff_t>(stride), c.depth};
    const Sampled sampled(picture, c.interpolation);
    Job job{};
    job.source = sampled.source(), job.interpolation = c.interpolation;
    job.target = {nullptr, c.columns, c.rows, static_cast<ptrdiff_t>(pixel) * c.columns};
    job.coordinates = coordinates_of(c, memory, random), job.polar = circles_of(c, memory, random);
    const PackedMap map(job.coordinates, c.rows, c.columns, c.width, c.height, c.channels, is_deep(c.depth),
                        c.interpolation);
    const auto blocks = map.blocks_for(job.source.geometry.row_step);
    job.packed = map.packed(*blocks);
    if (c.is_averaged && c.interpolation == Interpolation::cubic) job.footprints = footprints_of(c, memory, random);
    Difference difference;
    const size_t bytes = pixel * static_cast<size_t>(c.columns) * static_cast<size_t>(c.rows);
    for (const Where where : {Where::coordinates, Where::packed, Where::polar}) {
        const auto expected = sampled_by("plain", job, where == Where::packed ? Where::coordinates : where, bytes);
        for (const char* name : names) {
            const auto out = sampled_by(name, job, where, bytes);
            for (size_t i = 0; i < bytes && c.depth == Depth::u8; ++i) {
                const int off = std::abs(out[i] - expected[i]);
                difference.most = off > difference.most ? off : difference.most;
                difference.count += off != 0;
            }
        }
    }
    return difference;
}

}  // namespace

int main(int argc, char** argv) {
    const int cases = argc > 1 ? std::atoi(argv[1]) : 3000;
    std::mt19937 random(1);
    const int channels[] = {1, 2, 3, 4};
    std::vector<const char*> names;
    for (const char* name : {"avx2", "avx512", "avx512-gather", "neon"})
        if (use_kernels(name)) names.push_back(name);
    long differing = 0, worst = 0;
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
        const Difference d = run(c, names, random);
        differing += d.count;
        worst = d.most > worst ? d.most : worst;
    }
    for (const char* name : names) std::printf("%s ", name);
    std::printf("against plain: %d cases, %ld values differ, by at most %ld\n", cases, differing, worst);
    return worst > 2;
}
