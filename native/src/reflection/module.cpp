// The part of omnimirror._native that omnimirror.tracing.reflection and omnimirror.torch.compiled call.

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
using EndsSaid = std::tuple<Doubles, bool>;                                // points, or ways to distant ones

CubicPieces pieces_of(const Doubles& table, size_t columns) {
    require(table.ndim() == 2 && table.shape(0) > 0 && table.shape(1) == columns, "tables are (pieces, 4), a meridian's (pieces, 8)");
    return {table.data(), count_of(table.shape(0))};
}

ReflectionSurface surface_of(const Surface& said) {
    const auto& [meridian, cell, rim, least, x, y, z, telecentric] = said;
    require(cell > 0 && rim > 0 && least >= 0, "a cell and a rim are above 0, the least distance is not below");
    return {pieces_of(meridian, 8), cell, rim, least, {x, y, z}, telecentric};
}

ReflectionSearch search_of(const Search& said) {
    const auto& [steps, first_steps, close, first_close, longest, reach, rim_slack] = said;
    require(steps > 0 && first_steps >= 0 && close > 0, "there is one step at least, and close is above 0");
    return {steps, first_steps, close, first_close, longest, reach, rim_slack};
}

// Rows (k, n), each as long as the arrays that they go with.
template <class Job>
void set_rows(Job& job, const DoublesOut& rows, const BytesOut& states, size_t count, size_t wanted) {
    require(rows.ndim() == 2 && rows.shape(0) == wanted && rows.shape(1) == count, "rows are as long as what is asked");
    require(states.ndim() == 1 && states.shape(0) == count, "states are as many as what is asked");
    for (size_t row = 0; row < wanted; ++row) job.rows[row] = rows.data() + row * count;
    job.states = states.data();
    job.count = count_of(count);
}

void set_asked(const double* (&parts)[3], const Doubles& asked) {
    require(asked.ndim() == 2 && asked.shape(0) == 3, "targets and ways are (3, n)");
    for (size_t axis = 0; axis < 3; ++axis) parts[axis] = asked.data() + axis * asked.shape(1);
}

void seen(const Surface& surface, const Search& search, const Doubles& by_omega, std::tuple<double, double> omegas,
          double middle, bool distant, const Doubles& targets, const DoublesOut& rows, const BytesOut& states) {
    const auto [low, high] = omegas;
    require(high >= low, "field angles do not fall");
    SeenJob job{surface_of(surface), search_of(search), pieces_of(by_omega, 4), {low, high}, middle, distant, {}, 0, {}, nullptr};
    set_asked(job.targets, targets);
    set_rows(job, rows, states, targets.shape(1), SEEN_ROWS);
    nb::gil_scoped_release released;
    find_reflections(job);
}

void met(const Surface& surface, const Search& search, const Doubles& depth, double most_tangent, const Doubles& ways,
         const DoublesOut& rows, const BytesOut& states) {
    require(most_tangent > 0, "the steepest ray has a tangent above 0");
    MetJob job{surface_of(surface), search_of(search), pieces_of(depth, 4), most_tangent, {}, 0, {}, nullptr};
    require(!job.surface.telecentric, "rays of a telecentric lens do not start at a pupil");
    set_asked(job.ways, ways);
    set_rows(job, rows, states, ways.shape(1), MET_ROWS);
    nb::gil_scoped_release released;
    meet_mirror(job);
}

Wall wall_of(const WallSaid& said) {
    const auto& [kind, places, radii, index, outside] = said;
    require(kind >= 0 && kind <= 2, "a wall is a window (0), a tube (1) or a dome (2)");
    require(index > 0 && outside > 0, "refractive indices are above 0");
    const auto [near, far] = places;
    const auto [inner, outer] = radii;
    return {static_cast<WallKind>(kind), {near, far}, {inner, outer}, index, outside};
}

void require_rows(const Doubles& rows, size_t count, size_t columns) {
    require(rows.ndim() == 2 && rows.shape(0) == count && rows.shape(1) == columns, "points and directions are (n, 3)");
}

// Rays (n, 3) out through a wall: vectors (5, n, 3), numbers (4, n) and flags (2, n) are written.
void through_wall(const WallSaid& wall, const Doubles& points, const Doubles& directions, const DoublesOut& vectors,
                  const DoublesOut& numbers, const BytesOut& flags) {
    const size_t count = points.ndim() == 2 ? points.shape(0) : 0;
    for (const Doubles* rays : {&points, &directions}) require_rows(*rays, count, 3);
    require(vectors.ndim() == 3 && vectors.shape(0) == WALL_VECTORS && vectors.shape(1) == count && vectors.shape(2) == 3,
            "vectors are (5, n, 3)");
    require(numbers.ndim() == 2 && numbers.shape(0) == WALL_NUMBERS && numbers.shape(1) == count, "numbers are (4, n)");
    require(flags.ndim() == 2 && flags.shape(0) == 2 && flags.shape(1) == count, "flags are (2, n)");
    WallJob job{wall_of(wall), points.data(), directions.data(), count_of(count), {}, {}, flags.data(), flags.data() + count};
    for (size_t row = 0; row < WALL_VECTORS; ++row) job.vectors[row] = vectors.data() + 3 * row * count;
    for (size_t row = 0; row < WALL_NUMBERS; ++row) job.numbers[row] = numbers.data() + row * count;
    nb::gil_scoped_release released;
    leave(job);
}

// Where mirror points (n, 2) come to from where they begin, so that rays from pupils lead through a wall to targets.
void covered(const MirrorSaid& mirror, const WallSaid& wall, Pair ends, std::tuple<int, double, double> search,
             const EndsSaid& pupils, const EndsSaid& targets, const DoublesOut& xy, const BytesOut& settled) {
    const auto& [meridian, cell, rim, turn, shift] = mirror;
    require(cell > 0 && rim > 0, "a cell and a rim are above 0");
    require(turn.size() == 9 && shift.size() == 3, "a mirror's turn is (3, 3), its shift (3,)");
    const auto& [from, are_pupils_distant] = pupils;
    const auto& [to, are_targets_distant] = targets;
    const size_t count = to.ndim() == 2 ? to.shape(0) : 0;
    for (const Doubles* rows : {&from, &to}) require_rows(*rows, count, 3);
    require(xy.ndim() == 2 && xy.shape(0) == count && xy.shape(1) == 2, "mirror points are (n, 2)");
    require(settled.size() == count, "what has settled is (n,)");
    const auto [steps, longest, close] = search;
    const auto [low, high] = ends;
    CoveredJob job{pieces_of(meridian, 8), cell, rim, wall_of(wall), {low, high}, {}, {}, steps, longest, close,
                   from.data(), to.data(), are_pupils_distant, are_targets_distant, count_of(count), xy.data(), settled.data()};
    std::copy_n(turn.data(), 9, job.turn);
    std::copy_n(shift.data(), 3, job.shift);
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
