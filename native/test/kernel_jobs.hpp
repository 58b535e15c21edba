// Random jobs of all kernels except the samplers, with numeric results that must agree between instruction sets.
//
// A job is a function that computes with the selected instruction set and returns its results. Discrete results, such
// as whether a ray hits the mirror, may differ because of rounding, for a small share of all values.
#pragma once

#include <cmath>
#include <functional>
#include <random>
#include <vector>

#include "deconvolution/deconvolution.hpp"
#include "designs/designs.hpp"
#include "exposure/exposure.hpp"
#include "reflection/reflection.hpp"
#include "sampling/axial.hpp"
#include "tolerancing/trials.hpp"

namespace omnimirror {
namespace {

using Numbers = std::vector<double>;
using Random = std::mt19937;

struct OtherJob {
    const char* name;
    double tolerance;  // of |a - b| / (1 + |a|)
    std::function<Numbers()> compute;
};

double between(Random& random, double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
}

int count_between(Random& random, int low, int high) { return low + static_cast<int>(random() % (high - low + 1)); }

template <class T>
std::vector<T> randoms(Random& random, size_t count, double low, double high) {
    std::vector<T> values(count);
    for (T& value : values) value = static_cast<T>(between(random, low, high));
    return values;
}

template <class T>
void append(Numbers& to, const std::vector<T>& values) {
    to.insert(to.end(), values.begin(), values.end());
}

// -- a convex sphere, its vertex at the origin, before a lens at z = -distance ---------------------------

struct Sphere {
    double radius;
    double sag(double r) const { return r * r / (radius + std::sqrt(radius * radius - r * r)); }
    double slope(double r) const { return r / std::sqrt(radius * radius - r * r); }
    double bend(double r) const { return radius * radius / std::pow(radius * radius - r * r, 1.5); }
};

constexpr double RADIUS = 60, RIM = 40, DISTANCE = 180;

// Sag and slope as cubic Hermite pieces (8 numbers each).
Numbers meridian_of(const Sphere& sphere, int pieces, double cell) {
    Numbers table;
    const auto add = [&](double f0, double g0, double f1, double g1) {
        const double d = f1 - f0;
        for (const double c : {f0, g0, 3 * d - 2 * g0 - g1, g0 + g1 - 2 * d}) table.push_back(c);
    };
    for (int i = 0; i < pieces; ++i) {
        const double a = i * cell, b = a + cell;
        add(sphere.sag(a), sphere.slope(a) * cell, sphere.sag(b), sphere.slope(b) * cell);
        add(sphere.slope(a), sphere.bend(a) * cell, sphere.slope(b), sphere.bend(b) * cell);
    }
    return table;
}

// The direction (3) of the ray from the lens after reflection at a point (x, y) of a sphere.
void reflected_direction(const Sphere& sphere, double x, double y, double* direction_to) {
    const double r = std::hypot(x, y), z = sphere.sag(r), tilt = r > 0 ? sphere.slope(r) / r : 0;
    const double in[3] = {x, y, z + DISTANCE}, normal[3] = {tilt * x, tilt * y, -1};
    double along = 0, square = 0, size = 0;
    for (int c = 0; c < 3; ++c) along += in[c] * normal[c], square += normal[c] * normal[c], size += in[c] * in[c];
    for (int c = 0; c < 3; ++c) direction_to[c] = (in[c] - 2 * along / square * normal[c]) / std::sqrt(size);
}

// -- jobs -----------------------------------------------------------------------------------------------

OtherJob projection(Random& random) {
    const bool is_near = random() % 2;
    const auto targets = randoms<double>(random, 3 * static_cast<size_t>(count_between(random, 1, 2000)), -500, 500);
    const int entries = count_between(random, 20, 200);
    Numbers radii, origins;
    for (int i = 0; i < entries; ++i) {
        const double q = 0.9 * i / (entries - 1);
        radii.push_back(500 * q), origins.push_back(40 * q), origins.push_back(-20 * q * q);
    }
    return {"projection", 1e-10, [=] {
                const Axial a{{0, 0, 1}, {1, 0, 0}, {0, 1, 0}, 500, 500, 999,     999,     0,
                              0.9,       0,         0,         0,   0,   nullptr, nullptr, 3};
                const AxialCamera camera(a, radii, origins);
                const int64_t count = static_cast<int64_t>(targets.size() / 3);
                Numbers pixels(2 * static_cast<size_t>(count)), excess(static_cast<size_t>(count));
                camera.project({targets.data(), count, is_near, pixels.data(), excess.data()});
                append(pixels, excess);
                return pixels;
            }};
}

OtherJob designs(Random& random) {
    const int count = count_between(random, 1, 70), angles = count_between(random, 2, 30),
              kind = count_between(random, 0, 3);
    constexpr int TERMS = 2;
    const bool paper = random() % 2;
    Numbers coefficients, numbers, basis(3 * TERMS * static_cast<size_t>(angles)), fractions, surfaces;
    for (int d = 0; d < count; ++d) {
        coefficients.push_back(between(random, 0.3, 0.5)), coefficients.push_back(between(random, -0.05, 0.05));
        for (const double n : {between(random, 150, 250), 44.0, 11.6, 4.0, 50.0, 0.0, 0.0}) numbers.push_back(n);
        for (const double n : {60.0, 63.0, -100.0, -103.0, 0.0, 100.0, 1.0}) surfaces.push_back(n);
    }
    for (int i = 0; i < angles; ++i) {
        const double u = static_cast<double>(i) / (angles - 1);
        fractions.push_back(u);
        for (int t = 0; t < TERMS; ++t) {
            const double p = 2 * t + 2;
            const size_t at = static_cast<size_t>(t * angles + i), part = TERMS * static_cast<size_t>(angles);
            basis[at] = std::pow(u, p), basis[at + part] = p * std::pow(u, p - 1);
            basis[at + 2 * part] = p * (p - 1) * std::pow(u, p - 2);
        }
    }
    return {"designs", 1e-9, [=] {
                Numbers inverse(static_cast<size_t>(angles), 0.0);
                Numbers columns(DESIGN_COLUMNS * static_cast<size_t>(count * angles)),
                    results(3 * static_cast<size_t>(count));
                const double* part = basis.data();
                const int size = TERMS * angles;
                evaluate_designs({coefficients.data(),
                                  numbers.data(),
                                  part,
                                  part + size,
                                  part + 2 * size,
                                  fractions.data(),
                                  inverse.data(),
                                  count,
                                  TERMS,
                                  angles,
                                  false,
                                  paper,
                                  0.083,
                                  0,
                                  550,
                                  0,
                                  {21, 0.1, 1e-9, 60, 0.05, 4},
                                  {},
                                  surfaces.data(),
                                  static_cast<DesignShell::Kind>(kind),
                                  1.49,
                                  1,
                                  columns.data(),
                                  results.data(),
                                  results.data() + count,
                                  results.data() + 2 * count});
                append(columns, results);
                return columns;
            }};
}

OtherJob reflections(Random& random) {
    const Sphere sphere{RADIUS};
    constexpr int PIECES = 200;
    const double cell = RIM / PIECES;
    const int count = count_between(random, 1, 700);
    const bool is_intersection = random() % 2;
    Numbers rays(3 * static_cast<size_t>(count));
    for (int i = 0; i < count; ++i) {
        const double r = between(random, 0, 0.95 * RIM), angle = between(random, 0, 6.3);
        double direction_to[3];
        reflected_direction(sphere, r * std::cos(angle), r * std::sin(angle), direction_to);
        const double direction[3] = {r * std::cos(angle), r * std::sin(angle), sphere.sag(r) + DISTANCE};
        for (int c = 0; c < 3; ++c)
            rays[static_cast<size_t>(c * count + i)] = is_intersection ? direction[c] / direction[2] : direction_to[c];
    }
    return {"reflections", 1e-10, [=] {
                const Numbers meridian = meridian_of(sphere, PIECES, cell);
                // Linear initial values: distances from the axis as a function of the field angle, depths as a function
                // of the tangent.
                const Numbers begin{0, RIM, 0, 0}, depth{DISTANCE, 0, 0, 0};
                const ReflectionSurface surface{{meridian.data(), PIECES}, cell, RIM, 0, {0, 0, -DISTANCE}, false};
                const ReflectionSearch search{40, 8, 1e-10, 1e-3, 0.3, 1.2, 1e-9};
                Numbers rows(REFLECTION_ROWS * static_cast<size_t>(count));
                std::vector<uint8_t> states(static_cast<size_t>(count));
                const auto set = [&](auto& job, const double*(&parts)[3], int row_count) {
                    for (int c = 0; c < 3; ++c) parts[c] = rays.data() + c * count;
                    for (int r = 0; r < row_count; ++r) job.rows[r] = rows.data() + r * count;
                    job.count = count, job.states = states.data();
                };
                if (is_intersection) {
                    IntersectionJob job{surface, search, {depth.data(), 1}, 0.5, {}, 0, {}, nullptr};
                    set(job, job.directions, INTERSECTION_ROWS);
                    intersect_mirror(job);
                } else {
                    ReflectionJob job{surface, search, {begin.data(), 1}, {0, 2.2}, 0, true, {}, 0, {}, nullptr};
                    set(job, job.targets, REFLECTION_ROWS);
                    find_reflections(job);
                }
                append(rows, states);
                return rows;
            }};
}

OtherJob trials(Random& random) {
    const Sphere sphere{RADIUS};
    const int count = count_between(random, 1, 100), objects = count_between(random, 6, 40);
    const int terms = random() % 2 ? 4 : 0, powers = random() % 2 ? 1 : 15, refocus = count_between(random, 0, 2);
    Numbers numbers, targets, start;
    for (int t = 0; t < count; ++t) {
        Numbers n(static_cast<size_t>(TRIAL_NUMBERS + terms + powers), 0.0);
        for (const int i : {0, 4, 8}) n[static_cast<size_t>(ROTATION + i)] = 1;
        n[SHIFT + 2] = DISTANCE, n[PUPIL + 2] = -DISTANCE + between(random, -1, 1), n[PUPIL] = between(random, -1, 1);
        n[CURVATURE] = between(random, 0.98, 1.02) / RADIUS, n[CONIC] = between(random, -0.01, 0.01), n[APERTURE] = 2.9;
        n[VERGENCE] = 1 / 200.0, n[BREATHING] = 0.1, n[BROWN] = between(random, -0.01, 0.01), n[FOCAL] = 11.6;
        for (const int i : {0, 4}) n[static_cast<size_t>(IMAGER + i)] = 1000;
        n[IMAGER + 6] = between(random, -0.01, 0.01) * static_cast<double>(random() % 2), n[IMAGER + 8] = 1;
        for (int i = 0; i < terms + powers; ++i)
            n[static_cast<size_t>(TRIAL_NUMBERS + i)] = between(random, -1e-3, 1e-3);
        append(numbers, n);
    }
    for (int i = 0; i < objects; ++i) {
        const double r = between(random, 0.1, 0.8) * RIM, angle = between(random, 0, 6.3);
        double direction_to[3];
        reflected_direction(sphere, r * std::cos(angle), r * std::sin(angle), direction_to);
        targets.insert(targets.end(), direction_to, direction_to + 3);
        start.push_back(r * std::cos(angle)), start.push_back(r * std::sin(angle));
    }
    const size_t n = static_cast<size_t>(objects);
    const auto reference = randoms<double>(random, 2 * n, -200, 200), deg = randoms<double>(random, 4 * n, -1, 1);
    const auto area = randoms<double>(random, n, 50, 100), affine = randoms<double>(random, 2 * 2 * n, -0.1, 0.1);
    const auto basis = randoms<double>(random, 3 * 2 * n, -0.1, 0.1), linear = randoms<double>(random, 3 * 2, 0.5, 1);
    const auto quadratic = randoms<double>(random, 3 * 3, -1e-3, 1e-3),
               radial = randoms<double>(random, 2 * n, -0.1, 0.1);
    return {"trials", 1e-7, [=] {
                Numbers merits(static_cast<size_t>(count * TRIAL_MERITS)),
                    displacements(static_cast<size_t>(count) * 2 * n);
                evaluate_trials(
                    {numbers.data(),
                     count,
                     terms,
                     powers,
                     true,
                     RIM,
                     {nullptr, 0, 1},
                     {targets.data(), start.data(), reference.data(), deg.data(), area.data(), objects, true},
                     {affine.data(), basis.data(), linear.data(), quadratic.data(), radial.data(), 2, 3, 2, 1, 3},
                     {30, 1e-10, 1e-6, 0.2, 40},
                     static_cast<Refocus>(refocus),
                     1.0,
                     merits.data(),
                     displacements.data()});
                append(merits, displacements);
                return merits;
            }};
}

OtherJob exposures(Random& random) {
    const Sphere sphere{RADIUS};
    const int kind = count_between(random, 0, 2), samples = count_between(random, 1, 20);
    const int rows = count_between(random, 1, 12), columns = count_between(random, 1, 60),
              nodes = count_between(random, 0, 1) * 100;
    const auto points = randoms<float>(random, 4 * static_cast<size_t>(samples), 0, 0.999);
    std::vector<float> texels(4 * 16 * (32 + 2));
    for (size_t row = 0; row < 16; ++row)
        for (size_t column = 0; column < 34; ++column)
            for (size_t c = 0; c < 3; ++c)
                texels[4 * (34 * row + column) + c] =
                    static_cast<float>(1 + std::sin(0.4 * static_cast<double>(column % 32 + row + c)));
    Optics o;
    o.centre[0] = static_cast<float>(columns) / 2, o.centre[1] = static_cast<float>(rows) / 2;
    o.scale[0] = o.scale[1] = 0.4f / static_cast<float>(columns), o.focus = 200,
    o.stop = 1.5f * static_cast<float>(random() % 2);
    o.distortion[0] = random() % 2 ? 0.05f : 0, o.vertex[2] = static_cast<float>(DISTANCE);
    o.curvature = static_cast<float>(1 / RADIUS), o.rim = static_cast<float>(RIM), o.natural_vignetting = 1;
    o.body_radius = 10, o.lens_radius = 5, o.housing_light[0] = 0.1f, o.direct_view = random() % 2;
    std::vector<MeridianNode> meridian;
    for (int i = 0; i <= nodes && nodes; ++i) {
        const double r = RIM * i / nodes;
        meridian.push_back({static_cast<float>(sphere.sag(r)), static_cast<float>(sphere.slope(r)),
                            static_cast<float>(sphere.bend(r))});
    }
    std::vector<Surface> parallelograms;  // around the sensor; some are triangles
    for (int i = 0; i < 60; ++i) {
        Surface s{};
        for (float& x : s.corner) x = static_cast<float>(between(random, -900, 900));
        for (auto& side : s.side)
            for (float& x : side) x = static_cast<float>(between(random, -500, 500));
        s.texel_side[0][0] = 30, s.texel_side[1][1] = 14, s.kind = i % 3 ? 0 : -1;
        parallelograms.push_back(s);
    }
    return {kind == 0   ? "light"
            : kind == 1 ? "rays"
                        : "surfaces",
            1e-4, [=] {
                Exposure e{o, {points.data(), samples, true, 7}, 0, columns};
                e.optics.nodes = meridian.empty() ? nullptr : meridian.data();
                e.optics.cells = nodes, e.optics.step = static_cast<float>(RIM / (nodes ? nodes : 1));
                const size_t pixels = static_cast<size_t>(rows) * static_cast<size_t>(columns),
                             rays = pixels * static_cast<size_t>(samples);
                Numbers results;
                std::vector<float> light(3 * pixels), origins(3 * rays), directions(3 * rays), weights(rays);
                std::vector<uint8_t> fates(rays);
                if (kind == 0) {
                    expose(e, {texels.data(), 32, 16}, 0, rows, light.data());
                    append(results, light);
                } else if (kind == 1) {
                    expose(e, 0, rows, {origins.data(), directions.data(), weights.data(), fates.data()});
                    for (size_t i = 0; i < rays; ++i) {  // lost rays are absent
                        const bool counts = fates[i] != 0;
                        results.push_back(fates[i]), results.push_back(counts ? weights[i] : 0);
                        double size = 0;
                        for (size_t c = 3 * i; c < 3 * i + 3; ++c) size += double{directions[c]} * directions[c];
                        for (size_t c = 3 * i; c < 3 * i + 3; ++c) {
                            results.push_back(counts ? origins[c] : 0);
                            results.push_back(counts ? directions[c] / std::sqrt(size) : 0);
                        }
                    }
                } else {
                    const std::shared_ptr<const float> shared(texels.data(), [](const float*) {});
                    const Surfaces surfaces(parallelograms, {{0, 34, 16, 0}}, shared);
                    std::vector<int32_t> open(rays);
                    std::vector<float> open_rays(7 * rays);
                    const int64_t open_count =
                        expose(e, surfaces.tree(), 0, rows, light.data(), {open.data(), open_rays.data(), true});
                    append(results, light);
                    std::vector<float> radiance(4 * rays), distances(rays);
                    expose(e, 0, rows, {origins.data(), directions.data(), weights.data(), fates.data()});
                    surfaces.radiance(origins.data(), directions.data(), static_cast<int64_t>(rays), radiance.data(),
                                      distances.data());
                    append(results, radiance);
                    results.push_back(static_cast<double>(open_count) / static_cast<double>(rays));
                }
                return results;
            }};
}

OtherJob deblurring(Random& random) {
    const int width = count_between(random, 8, 60), height = count_between(random, 8, 50),
              channels = random() % 2 ? 1 : 3;
    BlurKernels blur{};
    blur.width = width, blur.height = height, blur.fineness = count_between(random, 1, 3);
    blur.block = 1 << count_between(random, 0, 3), blur.reach = 1;
    blur.first_taps = {0};
    const int f = blur.fineness, span = count_between(random, 1, 6);
    for (int n = 0; n < 3; ++n) {
        for (int i = 0; i < 6; ++i) {
            const Tap tap{count_between(random, -span, span), count_between(random, -span, span),
                          static_cast<float>(1.0 / 6)};
            for (const int along : {tap.down, tap.right})
                blur.reach = std::max(blur.reach, along < 0 ? (f - 1 - along) / f : along / f);
            blur.taps.push_back(tap);
        }
        blur.first_taps.push_back(static_cast<int32_t>(blur.taps.size()));
    }
    const size_t pixels = static_cast<size_t>(width) * static_cast<size_t>(height);
    blur.kernels.resize(static_cast<size_t>(height) * static_cast<size_t>(blur.groups() * GROUP / blur.block));
    for (int32_t& kernel : blur.kernels) kernel = count_between(random, 0, 2);
    blur.known.assign(pixels, 1), blur.concentration.assign(pixels, 1.0f);
    const Box all{0, height, 0, width};
    blur.tiles.push_back({all, all, all});
    const auto roots = randoms<float>(random, pixels * static_cast<size_t>(channels), 0.1, 1);
    const auto costs = randoms<float>(random, pixels, 1e-4, 1e-2);
    return {"deblurring", 1e-4, [=] {
                Deconvolution deconvolution(blur, channels, roots.data(), roots.data());
                const DeconvolutionKernel& kernel = deconvolution_kernel();
                const int32_t steps[] = {3};
                std::vector<float> light(roots.size()), blurred(roots.size(), 0), steepness(pixels);
                kernel.improve(deconvolution, costs.data(), steps);
                kernel.light(deconvolution, light.data()), kernel.blurred(deconvolution, blurred.data());
                kernel.log_steepness(deconvolution, steepness.data());
                Numbers results;
                append(results, light), append(results, blurred), append(results, steepness);
                return results;
            }};
}

}  // namespace
}  // namespace omnimirror
