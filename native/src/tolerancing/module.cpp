// The part of omnimirror._native that omnimirror.tolerancing.trials calls.

#include <nanobind/stl/tuple.h>

#include <tuple>

#include "bindings.hpp"
#include "trials.hpp"

namespace omnimirror {
namespace {

using Pieces = std::tuple<Doubles, double>;
using Objects = std::tuple<Doubles, Doubles, Doubles, Doubles, Doubles, bool>;
using Rows = std::tuple<Doubles, Doubles, Doubles, Doubles, Doubles, int>;
using Search = std::tuple<int, double, double, double, int>;

RadialPieces pieces_of(const Pieces& table) {
    const auto& [coefficients, step] = table;
    require(coefficients.ndim() == 2 && coefficients.shape(1) == 6 && step > 0, "a table is (pieces, 6), its step above 0");
    return {coefficients.data(), count_of(coefficients.shape(0)), step};
}

TrialField field_of(const Objects& objects) {
    const auto& [targets, start, reference, deg_per_px, area, distant] = objects;
    const size_t n = targets.shape(0);
    require(targets.ndim() == 2 && targets.shape(1) == 3 && n > 0, "targets are (n, 3), one at least");
    for (const Doubles* pairs : {&start, &reference})
        require(pairs->ndim() == 2 && pairs->shape(0) == n && pairs->shape(1) == 2, "starts and references are (n, 2)");
    require(deg_per_px.ndim() == 2 && deg_per_px.shape(0) == n && deg_per_px.shape(1) == 4, "degrees a pixel are (n, 4)");
    require(area.ndim() == 1 && area.shape(0) == n, "areas are (n)");
    return {targets.data(), start.data(), reference.data(), deg_per_px.data(), area.data(), count_of(n), distant};
}

TrialCompensators compensators_of(const Rows& rows, size_t n) {
    const auto& [affine, basis, straight, bent, radial, rounds] = rows;
    for (const Doubles* part : {&affine, &basis, &radial})
        require(part->ndim() == 2 && part->shape(1) == 2 * n, "rows of compensators are (k, 2 n)");
    require(affine.shape(0) >= 2 && affine.shape(0) <= MOST_ROWS && radial.shape(0) <= MOST_ROWS, "rows are 2 to 16");
    require(basis.shape(0) <= MOST_BASIS, "a pose moves in 20 dimensions at most");
    const size_t e = basis.shape(0);
    require(straight.ndim() == 2 && straight.shape(0) == e && straight.shape(1) <= MOST_POSE, "straight is (e, pose)");
    const size_t pose = straight.shape(1);
    require(bent.ndim() == 2 && bent.shape(0) == e && bent.shape(1) == pose * (pose + 1) / 2, "bent is (e, pairs)");
    require(rounds >= 0, "rounds are 0 or more");
    return {affine.data(),        basis.data(),     straight.data(), bent.data(),           radial.data(),
            count_of(affine.shape(0)), count_of(e), count_of(pose),  count_of(radial.shape(0)), rounds};
}

void trials(const Doubles& numbers, int terms, bool is_conic, double rim, const Pieces& table, const Objects& objects,
            const Rows& rows, const Search& search, int refocus, double floor, const DoublesOut& merits,
            const DoublesOut& moved) {
    const TrialField field = field_of(objects);
    const auto n = static_cast<size_t>(field.count);
    require(numbers.ndim() == 2 && numbers.shape(1) > TRIAL_NUMBERS, "numbers are (trials, 35 + terms + powers)");
    const int trials = count_of(numbers.shape(0)), powers = count_of(numbers.shape(1)) - TRIAL_NUMBERS - terms;
    require(is_valid_term_count(terms), "terms are 0, 4, 8 or 16");
    require(is_valid_power_count(powers), "powers are 1, 15, 28 or 91");
    require(rim > 0 && floor >= 0, "a rim is above 0, a floor not below");
    require(refocus >= NOT_REFOCUSED && refocus <= LEAST_WORST, "a focus is 0, 1 or 2");
    require(merits.ndim() == 2 && merits.shape(0) == numbers.shape(0) && merits.shape(1) == TRIAL_MERITS,
            "merits are (trials, 24)");
    const bool wants_motion = moved.size() != 0;
    require(!wants_motion || (moved.ndim() == 2 && moved.shape(0) == numbers.shape(0) && moved.shape(1) == 2 * n),
            "motions are (trials, 2 n)");
    const auto [steps, close, reflects, rim_slack, halvings] = search;
    const TrialJob job{numbers.data(), trials, terms, powers, is_conic, rim, pieces_of(table), field,
                       compensators_of(rows, n), {steps, close, reflects, rim_slack, halvings},
                       static_cast<Refocus>(refocus), floor, merits.data(), wants_motion ? moved.data() : nullptr};
    nb::gil_scoped_release released;
    judge_trials(job);
}

}  // namespace

void add_tolerancing(nb::module_& m) {
    m.def("judge_trials", &trials, "numbers"_a, "terms"_a, "is_conic"_a, "rim"_a, "table"_a, "objects"_a, "rows"_a,
          "search"_a, "refocus"_a, "floor"_a, "merits"_a, "moved"_a);
}

}  // namespace omnimirror
