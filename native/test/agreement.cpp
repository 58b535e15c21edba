// Vector kernels against the plain ones, without Python: for cross-compiled builds under an emulator, and for
// the sanitizers. Buffers are allocated exactly, so that any access beyond one is seen.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <random>

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

Difference run(const Case& c, std::mt19937& random) {
    const size_t pixel = static_cast<size_t>(c.channels * size_of(c.depth));
    const size_t stride = pixel * static_cast<size_t>(c.width + c.gap);
    const size_t bytes = stride * static_cast<size_t>(c.height - 1) + pixel * static_cast<size_t>(c.width);
    std::unique_ptr<uint8_t[]> source(new uint8_t[bytes]);
    for (size_t i = 0; i < bytes; ++i) source[i] = static_cast<uint8_t>(random());
    if (c.depth == Depth::f32)
        for (size_t i = 0; i + 4 <= bytes; i += 4) {
            const float value = static_cast<float>(random() % 1000) / 1000;
            std::memcpy(source.get() + i, &value, 4);
        }
    const size_t places = static_cast<size_t>(c.columns) * static_cast<size_t>(c.rows);
    std::unique_ptr<float[]> where(new float[2 * places]);
    std::uniform_real_distribution<float> x(-1, static_cast<float>(c.width)), y(-1, static_cast<float>(c.height));
    for (size_t i = 0; i < places; ++i) {
        where[2 * i] = odd_or(x(random), random);
        where[2 * i + 1] = odd_or(y(random), random);
    }
    const Coordinates coordinates{reinterpret_cast<const uint8_t*>(where.get()), 8 * c.columns, false};
    const Picture picture{source.get(), c.width, c.height, c.channels, static_cast<ptrdiff_t>(stride), c.depth};
    const Sampled sampled(picture, c.interpolation);
    std::unique_ptr<uint8_t[]> out[3];
    Job job{};
    job.source = sampled.source(), job.interpolation = c.interpolation;
    const PackedMap map(coordinates, c.rows, c.columns, c.width, c.height, c.channels, is_deep(c.depth),
                        c.interpolation);
    const auto blocks = map.blocks_for(job.source.geometry.row_step);
    constexpr int STEP = 16;
    const int cell_columns = (c.columns + STEP - 1) / STEP, cell_rows = (c.rows + STEP - 1) / STEP;
    std::unique_ptr<uint8_t[]> taps(new uint8_t[static_cast<size_t>(2 * cell_columns * cell_rows)]);
    for (int i = 0; i < 2 * cell_columns * cell_rows; ++i) taps[i] = static_cast<uint8_t>(1 + random() % 4);
    if (c.is_averaged && c.interpolation == Interpolation::cubic) {
        const float x_middle = static_cast<float>(c.width) / 2, y_middle = static_cast<float>(c.height) / 2;
        const float most2 = random() % 2 ? 0.0f : x_middle * x_middle + 4;
        job.footprints = {taps.get(), cell_columns, STEP, random() % 2 ? 1.44f : 0, x_middle, y_middle, 0, most2};
    }
    const char* names[3] = {"plain", "avx2", "avx2"};
    for (int k = 0; k < 3; ++k) {
        out[k].reset(new uint8_t[places * pixel]);
        job.target = {out[k].get(), c.columns, c.rows, static_cast<ptrdiff_t>(pixel) * c.columns};
        job.where = k < 2 ? Where::coordinates : Where::packed;
        job.coordinates = coordinates;
        if (k == 2) job.packed = map.packed(*blocks);
        if (!use_kernels(names[k])) use_kernels("neon");
        sample(job);
    }
    Difference difference;
    for (int k = 1; k < 3 && c.depth == Depth::u8; ++k)
        for (size_t i = 0; i < places * pixel; ++i) {
            const int off = std::abs(out[k][i] - out[0][i]);
            difference.most = off > difference.most ? off : difference.most;
            difference.count += off != 0;
        }
    return difference;
}

}  // namespace

int main(int argc, char** argv) {
    const int cases = argc > 1 ? std::atoi(argv[1]) : 3000;
    std::mt19937 random(1);
    const int channels[] = {1, 2, 3, 4};
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
        const Difference d = run(c, random);
        differing += d.count;
        worst = d.most > worst ? d.most : worst;
    }
    std::printf("%s: %d cases, %ld values differ from the plain kernels, by at most %ld\n", kernels().name, cases,
                differing, worst);
    return worst > 2;
}
