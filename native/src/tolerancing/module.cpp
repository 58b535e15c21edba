// Python interface of tolerancing, used by omnimirror.manufacturing.tolerancing.evaluator.

#include <nanobind/stl/tuple.h>

#include <tuple>

#include "bindings.hpp"
#include "trials.hpp"

namespace omnimirror {
namespace {

using TableArguments = std::tuple<Doubles, double>;
using ObjectArguments = std::tuple<Doubles, Doubles, Doubles, Doubles, Doubles, bool>;
using CompensatorArguments = std::tuple<Doubles, Doubles, Doubles, Doubles, Doubles, int>;
using SearchArguments = std::tuple<int, double, double, double, int>;

constexpr int64_t MAX_PIECES = int64_t{1} << 24, MAX_OBJECTS = int64_t{1} << 24;  // products fit into int

RadialPieces pieces_of(const TableArguments& table) {
    const auto& [coefficients, step] = table;
    const double* first = checked(coefficients, "table", {ANY, 6});
    require(step > 0, "step of table must be above 0");
    return {first, count_of(coefficients.shape(0), "pieces", MAX_PIECES), step};
}

TrialField field_of(const ObjectArguments& object_field) {
    const auto& [targets, start, reference, deg_per_px, area, distant] = object_field;
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

TrialCompensators compensators_of(const CompensatorArguments& compensators, int64_t n) {
    const auto& [affine, basis, linear, quadratic, radial, iterations] = compensators;
    const int64_t pose = length_of(linear, 1), dimensions = length_of(basis, 0);
    const TrialCompensators c{checked(affine, "affine", {ANY, 2 * n}),
                              checked(basis, "basis", {ANY, 2 * n}),
                              checked(linear, "linear", {dimensions, ANY}),
                              checked(quadratic, "quadratic", {dimensions, pose * (pose + 1) / 2}),
                              checked(radial, "radial", {ANY, 2 * n}),
                              count_of(affine.shape(0), "rows of affine", MAX_COMPENSATOR_ROWS),
                              count_of(basis.shape(0), "rows of basis", MAX_BASIS_ROWS),
                              count_of(linear.shape(1), "columns of straight", MAX_POSE_PARAMETERS),
                              count_of(radial.shape(0), "rows of radial", MAX_COMPENSATOR_ROWS),
                              iterations_of(iterations, "iterations")};
    require(c.affine_rows >= 2, "affine must have at least 2 rows");
    return c;
}

void evaluate_trials_binding(const Doubles& numbers, int terms, bool is_conic, double rim, const TableArguments& table,
                             const ObjectArguments& object_field, const CompensatorArguments& compensators,
                             const SearchArguments& search, int refocus, double floor, const DoublesOut& merits,
                             const DoublesOut& displacements) {
    const TrialField field = field_of(object_field);
    require(is_valid_term_count(terms), "terms must be 0, 4, 8 or 16");
    const double* first_number = checked(numbers, "numbers", {ANY, ANY});
    const int powers = count_of(numbers.shape(1), "columns of numbers") - TRIAL_NUMBERS - terms;
    require(is_valid_power_count(powers), "powers must be 1, 15, 28 or 91");
    require(rim > 0 && floor >= 0, "rim must be above 0, and floor at least 0");
    const int64_t evaluate_trials_binding = length_of(numbers, 0);
    const auto [steps, tolerance, reflection_tolerance, rim_slack, focus_steps] = search;
    const TrialJob job{first_number,
                       count_of(numbers.shape(0), "evaluate_trials_binding"),
                       terms,
                       powers,
                       is_conic,
                       rim,
                       pieces_of(table),
                       field,
                       compensators_of(compensators, field.count),
                       {iterations_of(steps, "steps"), tolerance, reflection_tolerance, rim_slack,
                        iterations_of(focus_steps, "focus_steps")},
                       static_cast<Refocus>(checked<int>(refocus, "refocus", NO_REFOCUS, MIN_MAX)),
                       floor,
                       checked(merits, "merits", {evaluate_trials_binding, TRIAL_MERITS}),
                       displacements.size() ? checked(displacements, "displacements",
                                                      {evaluate_trials_binding, int64_t{2} * field.count})
                                            : nullptr};
    nb::gil_scoped_release released;
    evaluate_trials(job);
}

}  // namespace

void add_tolerancing(nb::module_& m) {
    m.def("evaluate_trials", &evaluate_trials_binding, "numbers"_a, "terms"_a, "is_conic"_a, "rim"_a, "table"_a,
          "object_field"_a, "compensators"_a, "search"_a, "refocus"_a, "floor"_a, "merits"_a, "displacements"_a);
}

}  // namespace omnimirror
