// Python interface of reflection and shell transmission, used by omnimirror.optics.tracing.reflection and
// omnimirror.interop.torch.

#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <cmath>
#include <tuple>

#include "bindings.hpp"
#include "reflection.hpp"
#include "shell_reflection.hpp"
#include "shell_transmission.hpp"

namespace omnimirror {
namespace {

using Surface = std::tuple<Doubles, double, double, double, double, double, double, bool>;
using Search = std::tuple<int, int, double, double, double, double, double>;
using Pair = std::tuple<double, double>;
using ShellArguments = std::tuple<int, Pair, Pair, double, double>;             // kind, places, radii, index, outside
using MirrorArguments = std::tuple<Doubles, double, double, Doubles, Doubles>;  // meridian, cell, rim, turn, shift
using EndpointArguments = std::tuple<Doubles, bool>;                            // points, or directions to distant ones

constexpr int64_t MAX_PIECES = int64_t{1} << 24;  // pieces times coefficients must fit into int

// Tables of cubic pieces: (pieces, 4), of a meridian (pieces, 8).
CubicPieces pieces_of(const Doubles& table, const char* name, int columns) {
    const double* first = checked(table, name, {ANY, columns});
    const int pieces = count_of(table.shape(0), "pieces", MAX_PIECES);
    if (!pieces) raise_invalid(name, "must not be empty");
    return {first, pieces};
}

ReflectionSurface surface_of(const Surface& arguments) {
    const auto& [meridian, cell, rim, min_radius, x, y, z, telecentric] = arguments;
    require(cell > 0 && rim > 0 && min_radius >= 0, "cell and rim must be above 0, and min_radius at least 0");
    return {pieces_of(meridian, "meridian", 8), cell, rim, min_radius, {x, y, z}, telecentric};
}

ReflectionSearch search_of(const Search& arguments) {
    const auto& [steps, first_steps, tolerance, first_tolerance, max_step, max_radius, rim_slack] = arguments;
    require(tolerance > 0, "tolerance must be above 0");
    return {iterations_of(steps, "steps", 1),
            iterations_of(first_steps, "first steps"),
            tolerance,
            first_tolerance,
            max_step,
            max_radius,
            rim_slack};
}

// Rays (3, n) and results: rows (k, n) and states (n,).
template <class Job>
void set_arrays(Job& job, const double* (&parts)[3], const char* name, const Doubles& rays, const DoublesOut& rows,
                const BytesOut& states, int64_t row_count) {
    const double* first = checked(rays, name, {3, ANY});
    const int64_t count = length_of(rays, 1);
    job.count = count_of(rays.shape(1), name);
    double* row = checked(rows, "rows", {row_count, count});
    for (int64_t i = 0; i < row_count; ++i) job.rows[i] = row + i * count;
    for (int64_t axis = 0; axis < 3; ++axis) parts[axis] = first + axis * count;
    job.states = checked(states, "states", {count});
}

void find_reflections_binding(const Surface& surface, const Search& search, const Doubles& by_omega,
                              std::tuple<double, double> omegas, double middle, bool distant, const Doubles& targets,
                              const DoublesOut& rows, const BytesOut& states) {
    const auto [low, high] = omegas;
    require(high >= low, "omegas must be in ascending order");
    ReflectionJob job{surface_of(surface),
                      search_of(search),
                      pieces_of(by_omega, "by_omega", 4),
                      {low, high},
                      middle,
                      distant,
                      {},
                      0,
                      {},
                      nullptr};
    set_arrays(job, job.targets, "targets", targets, rows, states, REFLECTION_ROWS);
    nb::gil_scoped_release released;
    find_reflections(job);
}

void intersect_mirror_binding(const Surface& surface, const Search& search, const Doubles& depth, double max_tangent,
                              const Doubles& directions, const DoublesOut& rows, const BytesOut& states) {
    require(max_tangent > 0, "max_tangent must be above 0");
    IntersectionJob job{
        surface_of(surface), search_of(search), pieces_of(depth, "depth", 4), max_tangent, {}, 0, {}, nullptr};
    require(!job.surface.telecentric,
            "surface must not be telecentric: the rays of a telecentric lens have no common origin");
    set_arrays(job, job.directions, "directions", directions, rows, states, INTERSECTION_ROWS);
    nb::gil_scoped_release released;
    intersect_mirror(job);
}

Shell shell_of(const ShellArguments& arguments) {
    const auto& [kind, heights, radii, index, outside] = arguments;
    checked(kind, "kind of shell", 0, 2);  // window, tube or dome
    require(index > 0 && outside > 0, "refractive indices must be above 0");
    const auto [near_height, far_height] = heights;
    const auto [inner, outer] = radii;
    return {static_cast<ShellKind>(kind), {near_height, far_height}, {inner, outer}, index, outside};
}

// Trace rays (n, 3) out through a shell; writes vectors (5, n, 3), numbers (4, n) and flags (2, n).
void shell_exit_binding(const ShellArguments& shell, const Doubles& points, const Doubles& directions,
                        const DoublesOut& vectors, const DoublesOut& numbers, const BytesOut& flags) {
    const int64_t count = length_of(points, 0);
    ShellJob job{shell_of(shell),
                 checked(points, "points", {ANY, 3}),
                 checked(directions, "directions", {count, 3}),
                 count_of(points.shape(0), "rays"),
                 {},
                 {},
                 checked(flags, "flags", {2, count}),
                 flags.data() + count};
    double* vector = checked(vectors, "vectors", {SHELL_VECTORS, count, 3});
    double* number = checked(numbers, "numbers", {SHELL_NUMBERS, count});
    for (int64_t row = 0; row < SHELL_VECTORS; ++row) job.vectors[row] = vector + 3 * row * count;
    for (int64_t row = 0; row < SHELL_NUMBERS; ++row) job.numbers[row] = number + row * count;
    nb::gil_scoped_release released;
    shell_exit(job);
}

// Refine mirror points (n, 2), from initial values, whose rays from pupils reach targets through a shell.
void find_reflections_through_shell_binding(const MirrorArguments& mirror, const ShellArguments& shell, Pair ends,
                                            std::tuple<int, double, double> search, const EndpointArguments& pupils,
                                            const EndpointArguments& targets, const DoublesOut& xy,
                                            const BytesOut& converged) {
    const auto& [meridian, cell, rim, rotation, shift] = mirror;
    require(cell > 0 && rim > 0, "cell and rim must be above 0");
    const auto& [from, are_pupils_distant] = pupils;
    const auto& [to, are_targets_distant] = targets;
    const int64_t count = length_of(to, 0);
    const auto [steps, max_step, tolerance] = search;
    const auto [low, high] = ends;
    ShellReflectionJob job{pieces_of(meridian, "meridian", 8),
                           cell,
                           rim,
                           shell_of(shell),
                           {low, high},
                           {},
                           {},
                           iterations_of(steps, "steps"),
                           max_step,
                           tolerance,
                           checked(from, "pupils", {count, 3}),
                           checked(to, "targets", {ANY, 3}),
                           are_pupils_distant,
                           are_targets_distant,
                           count_of(to.shape(0), "targets"),
                           checked(xy, "xy", {count, 2}),
                           checked(converged, "converged", {count})};
    std::copy_n(checked(rotation, "rotation", {3, 3}), 9, job.rotation);
    std::copy_n(checked(shift, "shift", {3}), 3, job.shift);
    nb::gil_scoped_release released;
    find_reflections_through_shell(job);
}

}  // namespace

void add_reflection(nb::module_& m) {
    m.def("find_reflections", &find_reflections_binding, "surface"_a, "search"_a, "by_omega"_a, "omegas"_a, "middle"_a,
          "distant"_a, "targets"_a, "rows"_a, "states"_a);
    m.def("shell_exit", &shell_exit_binding, "shell"_a, "points"_a, "directions"_a, "vectors"_a, "numbers"_a,
          "flags"_a);
    m.def("find_reflections_through_shell", &find_reflections_through_shell_binding, "mirror"_a, "shell"_a, "ends"_a,
          "search"_a, "pupils"_a, "targets"_a, "xy"_a, "converged"_a);
    m.def("intersect_mirror", &intersect_mirror_binding, "surface"_a, "search"_a, "depth"_a, "max_tangent"_a,
          "directions"_a, "rows"_a, "states"_a);
}

}  // namespace omnimirror
