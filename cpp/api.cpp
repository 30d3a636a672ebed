#include "api.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <exception>
#include <memory>
#include <new>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "checks.hpp"
#include "cholesky.hpp"
#include "condensation.hpp"
#include "filter.hpp"
#include "normal_equations.hpp"
#include "problem.hpp"
#include "sparse_rows.hpp"
#include "table.hpp"
#include "telling.hpp"

struct teamslam_blocks {
  teamslam::BlockPattern pattern;
  std::vector<double> values;
};

struct teamslam_problem {
  teamslam::Problem problem;
};

struct teamslam_analysis {
  teamslam::Analysis analysis;
};

struct teamslam_factor {
  teamslam::Cholesky cholesky;
};

struct teamslam_condensation {
  teamslam::Condensation condensation;
};

namespace {

using teamslam::BlockPattern;
using teamslam::SubmapInput;

thread_local std::string last_error;
std::atomic<int32_t> threads{1};

// Runs body, and turns what it throws into a message and `failure`.
template <class Result, class Body>
Result guarded(Result failure, const Body& body) {
  try {
    return body();
  } catch (const std::bad_alloc&) {
    last_error = "out of memory";
  } catch (const std::exception& error) {
    last_error = error.what();
  }
  return failure;
}

// Calls with the rows of a table, or with a user's, between variables of some kinds.
template <class Use>
int32_t with_rows(const std::vector<teamslam::Kind>& kinds, const teamslam::TableInput& input, int32_t keys,
                  int64_t residuals, teamslam_linearise_rows linearise, const Use& use) {
  if (!linearise) {
    const teamslam::LoneTable lone(kinds, input);
    return use({input.rows, teamslam::keys(input.model), lone.table.residual_size(), input.index,
                [&](const double* state, double* e, double* J) { lone.table.weighted(state, e, J); }});
  }
  for (int64_t i = 0; i < input.rows * keys; ++i)
    if (input.index[i] < 0 || input.index[i] >= static_cast<int64_t>(kinds.size()))
      teamslam::refuse("row ", i / keys, " names variable ", input.index[i], ", but there are ", kinds.size());
  return use({input.rows, keys, residuals, input.index, [&](const double* state, double* e, double* J) {
                if (linearise(state, e, J) < 0) teamslam::refuse("a user's rows could not be linearised");
              }});
}

BlockPattern pattern_of(int64_t variables, const int32_t* dof, const int64_t* column_start, const int32_t* row) {
  BlockPattern pattern;
  pattern.dof.assign(dof, dof + variables);
  pattern.column_start.assign(column_start, column_start + variables + 1);
  pattern.row.assign(row, row + pattern.column_start.back());
  pattern.scalar_start.assign(1, 0);
  for (int32_t size : pattern.dof) pattern.scalar_start.push_back(pattern.scalar_start.back() + size);
  pattern.value_start.reserve(pattern.row.size() + 1);
  pattern.value_start.push_back(0);
  for (int64_t c = 0; c < variables; ++c)
    for (int64_t k = pattern.column_start[c]; k < pattern.column_start[c + 1]; ++k)
      pattern.value_start.push_back(pattern.value_start.back() +
                                    static_cast<int64_t>(dof[pattern.row[k]]) * dof[c]);
  return pattern;
}

teamslam::Kind kind_of(int32_t number) {
  if (number < 0 || number >= teamslam::kinds) teamslam::refuse("submap: a member has kind ", number);
  return static_cast<teamslam::Kind>(number);
}

std::vector<int32_t> dofs_of(int64_t count, const int32_t* kind) {
  std::vector<int32_t> dofs(count);
  std::transform(kind, kind + count, dofs.begin(), [](int32_t number) { return teamslam::dof(kind_of(number)); });
  return dofs;
}

// Where each of many submaps begins among all members, numbers of the state, and unknowns.
struct SubmapStart {
  int64_t member, number, unknown;
};

std::vector<SubmapStart> starts_of(int64_t count, const int64_t* members, const int32_t* kind) {
  std::vector<SubmapStart> starts;
  SubmapStart next{0, 0, 0};
  for (int64_t k = 0; k < count; ++k) {
    starts.push_back(next);
    for (const int64_t end = next.member + members[k]; next.member < end; ++next.member) {
      next.number += teamslam::numbers(kind_of(kind[next.member]));
      next.unknown += teamslam::dof(kind_of(kind[next.member]));
    }
  }
  return starts;
}

}  // namespace

const char* teamslam_error(void) { return last_error.c_str(); }

void teamslam_set_threads(int32_t count) { threads = std::max(1, count); }

void teamslam_model_shape(int32_t model, int32_t dimension, int32_t shape[3]) {
  const auto which = static_cast<teamslam::Model>(model);
  shape[0] = teamslam::keys(which);
  shape[1] = teamslam::measurement_numbers(which, dimension);
  shape[2] = teamslam::residual_rows(which, dimension);
}

int32_t teamslam_sparse_rows(int64_t variables, const int32_t* dof, const int64_t* column_start, const int32_t* row,
                             const double* values, int64_t* start, int32_t* column, double* value) {
  return guarded<int32_t>(-1, [&] {
    return teamslam::rows_of(pattern_of(variables, dof, column_start, row), values, threads, start, column, value), 0;
  });
}

teamslam_blocks* teamslam_blocks_new(int64_t variables, const int32_t* dof, const int64_t* start, const int32_t* column,
                                     const double* value, int64_t sizes[2]) {
  return guarded<teamslam_blocks*>(nullptr, [&] {
    auto blocks = std::make_unique<teamslam_blocks>();
    blocks->pattern = teamslam::blocks_of({start, column, value}, {dof, dof + variables}, blocks->values);
    sizes[0] = blocks->pattern.blocks(), sizes[1] = blocks->pattern.size();
    return blocks.release();
  });
}

void teamslam_blocks_take(teamslam_blocks* blocks, int64_t* column_start, int32_t* row, double* values) {
  std::copy(blocks->pattern.column_start.begin(), blocks->pattern.column_start.end(), column_start);
  std::copy(blocks->pattern.row.begin(), blocks->pattern.row.end(), row);
  std::copy(blocks->values.begin(), blocks->values.end(), values);
  delete blocks;
}

teamslam_problem* teamslam_problem_new(int64_t variables, const int32_t* kinds, const uint8_t* fixed) {
  return guarded<teamslam_problem*>(
      nullptr, [&] { return new teamslam_problem{teamslam::Problem(variables, kinds, fixed)}; });
}

void teamslam_problem_free(teamslam_problem* problem) { delete problem; }

int64_t teamslam_add_table(teamslam_problem* problem, int32_t model, int32_t dimension, int64_t rows,
                           const int64_t* index, const double* z, const double* whitening, int32_t shared_whitening,
                           const double* sensor, int32_t loss, double scale) {
  return guarded<int64_t>(-1, [&] {
    return problem->problem.add_table({static_cast<teamslam::Model>(model), dimension, rows, index, z, whitening,
                                       shared_whitening != 0, sensor, static_cast<teamslam::Loss>(loss), scale});
  });
}

int64_t teamslam_add_submap(teamslam_problem* problem, int64_t base, int64_t members, const int64_t* member,
                            const int32_t* kind, const double* state, const int64_t* column_start, const int32_t* row,
                            const double* values, const double* eta) {
  return guarded<int64_t>(-1, [&] {
    const auto input = [&](int64_t) {
      BlockPattern pattern = pattern_of(members, dofs_of(members, kind).data(), column_start, row);
      std::vector<double> information(values, values + pattern.size());
      return SubmapInput{base, members, member, kind, state, eta, std::move(pattern), std::move(information)};
    };
    return problem->problem.add_submaps(1, input, 1);
  });
}

int64_t teamslam_add_submaps(teamslam_problem* problem, int64_t count, const int64_t* base, const int64_t* members,
                             const int64_t* member, const int32_t* kind, const double* state, const int64_t* start,
                             const int32_t* const* column, const double* const* values, const double* eta,
                             int64_t* sizes) {
  return guarded<int64_t>(-1, [&] {
    const std::vector<SubmapStart> starts = starts_of(count, members, kind);
    const auto input = [&](int64_t k) {
      const SubmapStart& at = starts[k];
      std::vector<double> information;
      BlockPattern pattern = teamslam::blocks_of({start + at.unknown + k, column[k], values[k]},
                                                 dofs_of(members[k], kind + at.member), information);
      sizes[k] = pattern.size();
      return SubmapInput{base[k], members[k], member + at.member, kind + at.member, state + at.number,
                         eta == nullptr ? nullptr : eta + at.unknown, std::move(pattern), std::move(information)};
    };
    return problem->problem.add_submaps(count, input, threads);
  });
}

int64_t teamslam_add_blocks(teamslam_problem* problem, int64_t count, int64_t keys, const int64_t* index,
                            int64_t residual_rows) {
  return guarded<int64_t>(-1, [&] { return problem->problem.add_blocks(count, keys, index, residual_rows); });
}

int32_t teamslam_set_weights(teamslam_problem* problem, int64_t handle, const double* weights) {
  return guarded<int32_t>(-1, [&] { return problem->problem.table(handle).set_weights(weights), 0; });
}

int32_t teamslam_set_whitening(teamslam_problem* problem, int64_t handle, const double* whitening,
                               int32_t shared_whitening) {
  return guarded<int32_t>(
      -1, [&] { return problem->problem.table(handle).set_whitening(whitening, shared_whitening != 0), 0; });
}

int32_t teamslam_set_curvature(teamslam_problem* problem, int64_t handle, int32_t curvature) {
  return guarded<int32_t>(-1, [&] {
    return problem->problem.term(handle).set_curvature(static_cast<teamslam::Curvature>(curvature)), 0;
  });
}

int32_t teamslam_set_submap(teamslam_problem* problem, int64_t handle, const double* state, const double* values,
                            const double* eta) {
  return guarded<int32_t>(-1, [&] { return problem->problem.submap(handle).set(state, values, eta), 0; });
}

int32_t teamslam_set_homes(teamslam_problem* problem, const int64_t* home) {
  return guarded<int32_t>(-1, [&] { return problem->problem.retraction().set_homes(home), 0; });
}

int32_t teamslam_normal_equations(int64_t variables, const int32_t* kinds, int32_t model, int32_t dimension,
                                  int64_t rows, const int64_t* index, const double* z, const double* whitening,
                                  int32_t shared_whitening, const double* sensor, int32_t loss, double scale,
                                  const double* state, double* H, double* g, double* cost) {
  return guarded<int32_t>(-1, [&] {
    const teamslam::TableInput input{static_cast<teamslam::Model>(model), dimension, rows, index, z, whitening,
                                     shared_whitening != 0, sensor, static_cast<teamslam::Loss>(loss), scale};
    *cost = teamslam::normal_equations(variables, kinds, input, state, H, g);
    return 0;
  });
}

int32_t teamslam_moved(int64_t variables, const int32_t* kinds, const uint8_t* turns, const double* centre,
                       const double* state, const double* covariance, int32_t model, int32_t dimension, int64_t rows,
                       const int64_t* index, const double* z, const double* whitening, int32_t shared_whitening,
                       const double* sensor, int32_t loss, double scale, int32_t keys, int64_t residuals,
                       teamslam_linearise_rows linearise, const double* step, int32_t backward, int32_t settled,
                       double* moved_state, double* moved_covariance) {
  return guarded<int32_t>(-1, [&] {
    const teamslam::Moving order(variables, kinds, turns, centre);
    const teamslam::TableInput input{static_cast<teamslam::Model>(model), dimension, rows, index, z, whitening,
                                     shared_whitening != 0, sensor, static_cast<teamslam::Loss>(loss), scale};
    const std::vector<teamslam::Kind> pair(2, order.kind[0]);
    return with_rows(pair, input, keys, residuals, linearise, [&](const teamslam::Sightings& steps) {
      return teamslam::moved(order, {state, covariance}, steps, step, backward != 0, settled != 0, moved_state,
                             moved_covariance);
    });
  });
}

int32_t teamslam_seen(int64_t variables, const int32_t* kinds, const uint8_t* turns, const double* centre,
                      const double* state, const double* covariance, int32_t model, int32_t dimension, int64_t rows,
                      const int64_t* index, const double* z, const double* whitening, int32_t shared_whitening,
                      const double* sensor, int32_t loss, double scale, int32_t keys, int64_t residuals,
                      teamslam_linearise_rows linearise, int64_t most, double little, double* seen_state,
                      double* seen_covariance) {
  return guarded<int32_t>(-1, [&] {
    const teamslam::Moving order(variables, kinds, turns, centre);
    const teamslam::TableInput input{static_cast<teamslam::Model>(model), dimension, rows, index, z, whitening,
                                     shared_whitening != 0, sensor, static_cast<teamslam::Loss>(loss), scale};
    return with_rows(order.kind, input, keys, residuals, linearise, [&](const teamslam::Sightings& sightings) {
      return teamslam::seen(order, {state, covariance}, sightings, most, little, seen_state, seen_covariance);
    });
  });
}

int32_t teamslam_told(int64_t variables, const int32_t* kinds, const uint8_t* turns, const double* centre,
                      const double* state, const double* covariance, int64_t map_variables, const int32_t* map_kinds,
                      const double* map_state, const double* map_covariance, const int64_t* theirs, int64_t count,
                      const int64_t* fresh, double* told_state, double* told_covariance) {
  return guarded<int32_t>(-1, [&] {
    const teamslam::Moving order(variables, kinds, turns, centre);
    const std::vector<uint8_t> still(map_variables);
    const teamslam::Moving map_order(map_variables, map_kinds, still.data(), std::array<double, 3>{}.data());
    return teamslam::told({order, {state, covariance}}, {map_order, {map_state, map_covariance}}, theirs, count, fresh,
                          told_state, told_covariance);
  });
}

int32_t teamslam_freeze(teamslam_problem* problem, int64_t sizes[5]) {
  return guarded<int32_t>(-1, [&] {
    problem->problem.freeze();
    const BlockPattern& pattern = problem->problem.pattern();
    sizes[0] = pattern.variables(), sizes[1] = pattern.blocks(), sizes[2] = pattern.size();
    sizes[3] = pattern.scalars(), sizes[4] = problem->problem.system_size();
    return 0;
  });
}

void teamslam_pattern(const teamslam_problem* problem, int32_t* dof, int64_t* column_start, int32_t* row) {
  const BlockPattern& pattern = problem->problem.pattern();
  std::copy(pattern.dof.begin(), pattern.dof.end(), dof);
  std::copy(pattern.column_start.begin(), pattern.column_start.end(), column_start);
  std::copy(pattern.row.begin(), pattern.row.end(), row);
}

int32_t teamslam_linearise(teamslam_problem* problem, const double* state, int64_t user_blocks, const int64_t* handles,
                           const double* const* e, const double* const* J, double* system, double* cost) {
  return guarded<int32_t>(-1, [&] {
    problem->problem.check_state(state);
    std::vector<teamslam::UserLinearisation> user;
    for (int64_t i = 0; i < user_blocks; ++i) user.push_back({handles[i], e[i], J[i]});
    *cost = problem->problem.linearise(state, user, threads, system);
    return 0;
  });
}

int32_t teamslam_slope(teamslam_problem* problem, const double* state, double* system, double* cost) {
  return guarded<int32_t>(-1, [&] {
    problem->problem.check_state(state);
    *cost = problem->problem.slope(state, threads, system);
    return 0;
  });
}

int32_t teamslam_cost(teamslam_problem* problem, const double* state, double* cost) {
  return guarded<int32_t>(-1, [&] {
    problem->problem.check_state(state);
    problem->problem.freeze();
    *cost = problem->problem.cost(state, threads);
    return 0;
  });
}

double teamslam_sharpest(const teamslam_problem* problem) { return problem->problem.sharpest(); }

int32_t teamslam_residuals(teamslam_problem* problem, int64_t handle, const double* state, double* whitened) {
  return guarded<int32_t>(-1, [&] {
    problem->problem.check_state(state);
    problem->problem.freeze();
    problem->problem.table(handle).residuals(state, whitened);
    return 0;
  });
}

int32_t teamslam_jacobians(teamslam_problem* problem, int64_t handle, const double* state, double* whitened) {
  return guarded<int32_t>(-1, [&] {
    problem->problem.check_state(state);
    problem->problem.freeze();
    problem->problem.table(handle).jacobians(state, whitened);
    return 0;
  });
}

int32_t teamslam_along(teamslam_problem* problem, int64_t handle, const double* state, const double* y,
                       int64_t columns, double* whitened) {
  return guarded<int32_t>(-1, [&] {
    problem->problem.check_state(state);
    problem->problem.freeze();
    const int64_t* start = problem->problem.pattern().scalar_start.data();
    problem->problem.table(handle).along(state, start, y, columns, whitened);
    return 0;
  });
}

int32_t teamslam_pull(teamslam_problem* problem, int64_t handle, const double* state, const double* whitened,
                      int64_t columns, double* sums) {
  return guarded<int32_t>(-1, [&] {
    problem->problem.check_state(state);
    problem->problem.freeze();
    const int64_t* start = problem->problem.pattern().scalar_start.data();
    problem->problem.table(handle).pull(state, start, whitened, columns, sums);
    return 0;
  });
}

int32_t teamslam_fault(teamslam_problem* problem, int64_t handle, const double* state, int64_t* row) {
  return guarded<int32_t>(-1, [&] {
    problem->problem.check_state(state);
    problem->problem.freeze();
    *row = problem->problem.term(handle).fault(state);
    return 0;
  });
}

int32_t teamslam_retract(teamslam_problem* problem, const double* state, const double* delta, double* out) {
  return guarded<int32_t>(-1, [&] { return problem->problem.retraction().move(state, delta, out), 0; });
}

teamslam_analysis* teamslam_analysis_new(int64_t variables, const int32_t* dof, const int64_t* column_start,
                                         const int32_t* row, int32_t ordering, const double* positions,
                                         const int32_t* last, int32_t last_count) {
  return guarded<teamslam_analysis*>(nullptr, [&] {
    return new teamslam_analysis{teamslam::analysed(pattern_of(variables, dof, column_start, row),
                                                    static_cast<teamslam::Ordering>(ordering), positions, last,
                                                    last_count, threads)};
  });
}

void teamslam_analysis_free(teamslam_analysis* analysis) { delete analysis; }

teamslam_factor* teamslam_factor_new(const teamslam_analysis* analysis) {
  return guarded<teamslam_factor*>(
      nullptr, [&] { return new teamslam_factor{teamslam::Cholesky(analysis->analysis, threads)}; });
}

void teamslam_factor_free(teamslam_factor* factor) { delete factor; }

int32_t teamslam_factorise(teamslam_factor* factor, const double* values, const double* damping, int32_t* pivot) {
  return guarded<int32_t>(-1, [&] { return *pivot = factor->cholesky.factor(values, damping), 0; });
}

int32_t teamslam_solve(const teamslam_factor* factor, double* rhs, int64_t columns) {
  return guarded<int32_t>(-1, [&] { return factor->cholesky.solve(rhs, columns), 0; });
}

int32_t teamslam_solve_lower(const teamslam_factor* factor, double* rhs, int64_t columns) {
  return guarded<int32_t>(-1, [&] { return factor->cholesky.solve_lower(rhs, columns), 0; });
}

int32_t teamslam_solve_upper(const teamslam_factor* factor, double* rhs, int64_t columns) {
  return guarded<int32_t>(-1, [&] { return factor->cholesky.solve_upper(rhs, columns), 0; });
}

double teamslam_log_determinant(const teamslam_factor* factor) { return factor->cholesky.log_determinant(); }

int32_t teamslam_inverse_on_pattern(const teamslam_factor* factor, double* values) {
  return guarded<int32_t>(-1, [&] { return factor->cholesky.inverse_on_pattern(values), 0; });
}

int32_t teamslam_diagonal_inverse(const teamslam_factor* factor, const int32_t* variables, int64_t count,
                                  double* blocks) {
  return guarded<int32_t>(-1, [&] { return factor->cholesky.diagonal_inverse(variables, count, blocks), 0; });
}

int32_t teamslam_eliminate(teamslam_factor* factor, const double* values, const double* damping, double* complement,
                           const double* rhs, double* reduced_rhs, int32_t* pivot) {
  return guarded<int32_t>(
      -1, [&] { return *pivot = factor->cholesky.eliminate(values, damping, complement, rhs, reduced_rhs), 0; });
}

int32_t teamslam_back_substitute(const teamslam_factor* factor, const double* last_solution, double* rhs_inout) {
  return guarded<int32_t>(-1, [&] { return factor->cholesky.back_substitute(last_solution, rhs_inout), 0; });
}

void teamslam_order(const teamslam_factor* factor, int64_t variables, int32_t* order) {
  std::copy_n(factor->cholesky.order(), variables, order);
}

void teamslam_statistics(const teamslam_factor* factor, double numbers[4]) {
  numbers[0] = static_cast<double>(factor->cholesky.factor_nonzeros());
  numbers[1] = factor->cholesky.flops();
  numbers[2] = static_cast<double>(factor->cholesky.bytes());
  numbers[3] = static_cast<double>(factor->cholesky.used());
}

teamslam_condensation* teamslam_condensation_new(int64_t variables, const int32_t* dof, const int64_t* start,
                                                 const int32_t* column, const double* value, uint8_t* gone,
                                                 int32_t frugal, int64_t sizes[3]) {
  return guarded<teamslam_condensation*>(nullptr, [&] {
    std::vector<double> values;
    const BlockPattern whole = teamslam::blocks_of({start, column, value}, {dof, dof + variables}, values);
    auto made = std::make_unique<teamslam_condensation>(teamslam_condensation{
        teamslam::Condensation(whole, values.data(), {gone, gone + variables}, frugal != 0, threads)});
    std::copy(made->condensation.gone().begin(), made->condensation.gone().end(), gone);
    const BlockPattern& stays = made->condensation.pattern();
    sizes[0] = stays.blocks(), sizes[1] = stays.size(), sizes[2] = made->condensation.failed();
    return made.release();
  });
}

void teamslam_condensation_free(teamslam_condensation* condensation) { delete condensation; }

int32_t teamslam_condensed_rows(const teamslam_condensation* condensation, int64_t* start, int32_t* column,
                                double* value) {
  return guarded<int32_t>(-1, [&] {
    const teamslam::Condensation& made = condensation->condensation;
    return teamslam::rows_of(made.pattern(), made.values().data(), threads, start, column, value), 0;
  });
}

int32_t teamslam_follow(const teamslam_condensation* condensation, const double* stays, double* gone) {
  return guarded<int32_t>(-1, [&] { return condensation->condensation.follow(stays, gone), 0; });
}
