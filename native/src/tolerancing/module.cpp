// Python interface of tolerancing, used by omnimirror.manufacturing.tolerancing.evaluator.

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

constexpr int64_t MAX_PIECES = int64_t{1} << 24, MAX_OBJECTS = int64_t{1} << 24;  // products fit into int

RadialPieces pieces_of(const Pieces& table) {
    const auto& [coefficients, step] = table;
    const double* first = checked(coefficients, "table", {ANY, 6});
    require(step > 0, "step of table must be above 0");
    return {first, count_of(coefficients.shape(0), "pieces", MAX_PIECES), step};
}

TrialField field_of(const Objects& objects) {
    const auto& [targets, start, reference, deg_per_px, area, distant] = objects;
    const double* first = checked(targets, "targets", {ANY, 3});
    const int count = count_of(targets.shape(0), "targets", MAX_OBJECTS);
    require(count > 0, "targets must not be empty");
    return {first,
            checked(start, "start", {count, 2}),
            checked(reference, "reference", {count, 2}),
            checked(deg_per_px, "deg_per_px", {count, 4}),
            checked(area, "area", {count}),
            count,
            distant};
}

TrialCompensators compensators_of(const Rows& rows, int64_t n) {
    const auto& [affine, basis, straight, bent, radial, rounds] = rows;
    const int64_t pose = length_of(straight, 1), dimensions = length_of(basis, 0);
    const TrialCompensators c{checked(affine, "affine", {ANY, 2 * n}),
                              checked(basis, "basis", {ANY, 2 * n}),
                              checked(straight, "straight", {dimensions, ANY}),
                              checked(bent, "bent", {dimensions, pose * (pose + 1) / 2}),
                              checked(radial, "radial", {ANY, 2 * n}),
                              count_of(affine.shape(0), "rows of affine", MOST_ROWS),
                              count_of(basis.shape(0), "rows of basis", MOST_BASIS),
                              count_of(straight.shape(1), "columns of straight", MOST_POSE),
                              count_of(radial.shape(0), "rows of radial", MOST_ROWS),
                              iterations_of(rounds, "rounds")};
    require(c.affine_rows >= 2, "affine must have at least two rows");
    return c;
}

void trials(const Doubles& numbers, int terms, bool is_conic, double rim, const Pieces& table, const Objects& objects,
            const Rows& rows, const Search& search, int refocus, double floor, const DoublesOut& merits,
            const DoublesOut& moved) {
    const TrialField field = field_of(objects);
    require(is_valid_term_count(terms), "terms must be 0, 4, 8 or 16");
    const double* first_number = checked(numbers, "numbers", {ANY, ANY});
    const int powers = count_of(numbers.shape(1), "columns of numbers") - TRIAL_NUMBERS - terms;
    require(is_valid_power_count(powers), "powers must be 1, 15, 28 or 91");
    require(rim > 0 && floor >= 0, "rim must be above 0, and floor at least 0");
    const int64_t trials = length_of(numbers, 0);
    const auto [steps, close, reflects, rim_slack, halvings] = search;
    const TrialJob job{
        first_number,
        count_of(numbers.shape(0), "trials"),
        terms,
        powers,
        is_conic,
        rim,
        pieces_of(table),
        field,
        compensators_of(rows, field.count),
        {iterations_of(steps, "steps"), close, reflects, rim_slack, iterations_of(halvings, "halvings")},
        static_cast<Refocus>(checked<int>(refocus, "refocus", NOT_REFOCUSED, LEAST_WORST)),
        floor,
        checked(merits, "merits", {trials, TRIAL_MERITS}),
        moved.size() ? checked(moved, "moved", {trials, int64_t{2} * field.count}) : nullptr};
    nb::gil_scoped_release released;
    judge_trials(job);
}

}  // namespace

void add_tolerancing(nb::module_& m) {
    m.def("judge_trials", &trials, "numbers"_a, "terms"_a, "is_conic"_a, "rim"_a, "table"_a, "objects"_a, "rows"_a,
          "search"_a, "refocus"_a, "floor"_a, "merits"_a, "moved"_a);
}

}  // namespace omnimirror
