// Python interface of reflection and shell transmission, used by omnimirror.optics.tracing.reflection and
// omnimirror.interop.torch.

#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <cmath>
#include <tuple>

#include "bindings.hpp"
#include "covered.hpp"
#include "reflection.hpp"
#include "walls.hpp"

namespace omnimirror {
namespace {

using Surface = std::tuple<Doubles, double, double, double, double, double, double, bool>;
using Search = std::tuple<int, int, double, double, double, double, double>;
using Pair = std::tuple<double, double>;
using WallSaid = std::tuple<int, Pair, Pair, double, double>;        // kind, places, radii, index, outside
using MirrorSaid = std::tuple<Doubles, double, double, Doubles, Doubles>;  // meridian, cell, rim, turn, shift
using EndsSaid = std::tuple<Doubles, bool>;                                // points, or directions to distant ones

constexpr int64_t MAX_PIECES = int64_t{1} << 24;  // pieces times coefficients must fit into int

// Tables of cubic pieces: (pieces, 4), of a meridian (pieces, 8).
CubicPieces pieces_of(const Doubles& table, const char* name, int columns) {
    const double* first = checked(table, name, {ANY, columns});
    const int pieces = count_of(table.shape(0), "pieces", MAX_PIECES);
    if (!pieces) refuse(name, "must not be empty");
    return {first, pieces};
}

ReflectionSurface surface_of(const Surface& said) {
    const auto& [meridian, cell, rim, least, x, y, z, telecentric] = said;
    require(cell > 0 && rim > 0 && least >= 0, "cell and rim must be above 0, and the least distance at least 0");
    return {pieces_of(meridian, "meridian", 8), cell, rim, least, {x, y, z}, telecentric};
}

ReflectionSearch search_of(const Search& said) {
    const auto& [steps, first_steps, close, first_close, longest, reach, rim_slack] = said;
    require(close > 0, "close must be above 0");
    return {iterations_of(steps, "steps", 1), iterations_of(first_steps, "first steps"), close, first_close, longest,
            reach, rim_slack};
}

// Rays (3, n) and results: rows (k, n) and states (n,).
template <class Job>
void set_arrays(Job& job, const double* (&parts)[3], const char* name, const Doubles& rays, const DoublesOut& rows,
                const BytesOut& states, int64_t wanted) {
    const double* first = checked(rays, name, {3, ANY});
    const int64_t count = length_of(rays, 1);
    job.count = count_of(rays.shape(1), name);
    double* row = checked(rows, "rows", {wanted, count});
    for (int64_t i = 0; i < wanted; ++i) job.rows[i] = row + i * count;
    for (int64_t axis = 0; axis < 3; ++axis) parts[axis] = first + axis * count;
    job.states = checked(states, "states", {count});
}

void seen(const Surface& surface, const Search& search, const Doubles& by_omega, std::tuple<double, double> omegas,
          double middle, bool distant, const Doubles& targets, const DoublesOut& rows, const BytesOut& states) {
    const auto [low, high] = omegas;
    require(high >= low, "omegas must not decrease");
    SeenJob job{surface_of(surface), search_of(search), pieces_of(by_omega, "by_omega", 4), {low, high}, middle, distant,
                {}, 0, {}, nullptr};
    set_arrays(job, job.targets, "targets", targets, rows, states, SEEN_ROWS);
    nb::gil_scoped_release released;
    find_reflections(job);
}

void met(const Surface& surface, const Search& search, const Doubles& depth, double most_tangent, const Doubles& ways,
         const DoublesOut& rows, const BytesOut& states) {
    require(most_tangent > 0, "most_tangent must be above 0");
    MetJob job{surface_of(surface), search_of(search), pieces_of(depth, "depth", 4), most_tangent, {}, 0, {}, nullptr};
    require(!job.surface.telecentric, "surface must not belong to a telecentric lens, whose rays start at no pupil");
    set_arrays(job, job.ways, "ways", ways, rows, states, MET_ROWS);
    nb::gil_scoped_release released;
    meet_mirror(job);
}

Wall wall_of(const WallSaid& said) {
    const auto& [kind, places, radii, index, outside] = said;
    checked(kind, "kind of wall", 0, 2);  // window, tube or dome
    require(index > 0 && outside > 0, "refractive indices must be above 0");
    const auto [near, far] = places;
    const auto [inner, outer] = radii;
    return {static_cast<WallKind>(kind), {near, far}, {inner, outer}, index, outside};
}

// Trace rays (n, 3) out through a shell; writes vectors (5, n, 3), numbers (4, n) and flags (2, n).
void through_wall(const WallSaid& wall, const Doubles& points, const Doubles& directions, const DoublesOut& vectors,
                  const DoublesOut& numbers, const BytesOut& flags) {
    const int64_t count = length_of(points, 0);
    WallJob job{wall_of(wall), checked(points, "points", {ANY, 3}), checked(directions, "directions", {count, 3}),
                count_of(points.shape(0), "rays"), {}, {}, checked(flags, "flags", {2, count}), flags.data() + count};
    double* vector = checked(vectors, "vectors", {WALL_VECTORS, count, 3});
    double* number = checked(numbers, "numbers", {WALL_NUMBERS, count});
    for (int64_t row = 0; row < WALL_VECTORS; ++row) job.vectors[row] = vector + 3 * row * count;
    for (int64_t row = 0; row < WALL_NUMBERS; ++row) job.numbers[row] = number + row * count;
    nb::gil_scoped_release released;
    leave(job);
}

// Refine mirror points (n, 2), from initial values, whose rays from pupils reach targets through a shell.
void covered(const MirrorSaid& mirror, const WallSaid& wall, Pair ends, std::tuple<int, double, double> search,
             const EndsSaid& pupils, const EndsSaid& targets, const DoublesOut& xy, const BytesOut& settled) {
    const auto& [meridian, cell, rim, turn, shift] = mirror;
    require(cell > 0 && rim > 0, "cell and rim must be above 0");
    const auto& [from, are_pupils_distant] = pupils;
    const auto& [to, are_targets_distant] = targets;
    const int64_t count = length_of(to, 0);
    const auto [steps, longest, close] = search;
    const auto [low, high] = ends;
    CoveredJob job{pieces_of(meridian, "meridian", 8),
                   cell,
                   rim,
                   wall_of(wall),
                   {low, high},
                   {},
                   {},
                   iterations_of(steps, "steps"),
                   longest,
                   close,
                   checked(from, "pupils", {count, 3}),
                   checked(to, "targets", {ANY, 3}),
                   are_pupils_distant,
                   are_targets_distant,
                   count_of(to.shape(0), "targets"),
                   checked(xy, "xy", {count, 2}),
                   checked(settled, "settled", {count})};
    std::copy_n(checked(turn, "turn", {3, 3}), 9, job.turn);
    std::copy_n(checked(shift, "shift", {3}), 3, job.shift);
    nb::gil_scoped_release released;
    find_covered(job);
}

}  // namespace

void add_reflection(nb::module_& m) {
    m.def("find_reflections", &seen, "surface"_a, "search"_a, "by_omega"_a, "omegas"_a, "middle"_a, "distant"_a, "targets"_a,
          "rows"_a, "states"_a);
    m.def("leave_wall", &through_wall, "wall"_a, "points"_a, "directions"_a, "vectors"_a, "numbers"_a, "flags"_a);
    m.def("find_covered", &covered, "mirror"_a, "wall"_a, "ends"_a, "search"_a, "pupils"_a, "targets"_a, "xy"_a,
          "settled"_a);
    m.def("meet_mirror", &met, "surface"_a, "search"_a, "depth"_a, "most_tangent"_a, "ways"_a, "rows"_a, "states"_a);
}

}  // namespace omnimirror
