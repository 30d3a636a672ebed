// A table of measurements of one model: many rows, each between one or two variables.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "models.hpp"
#include "term.hpp"
#include "variables.hpp"

namespace teamslam {

struct TableInput {
  Model model;
  int dimension;
  int64_t rows;
  const int64_t* index;     // rows x keys
  const double* z;          // rows x measurement_numbers
  const double* whitening;  // one or rows times residual_rows squared, row-major
  bool shared_whitening;
  const double* sensor;  // pose_numbers(dimension), or null
  Loss loss;
  double scale;
};

class Table final : public Term {
 public:
  // Checks and copies the input; throws std::invalid_argument with the row and what was expected.
  Table(const Variables& variables, const TableInput& input);

  // One factor per row on its part of H, g and cost, in the order of the input; null: none.
  void set_weights(const double* weights);
  // Another whitening in the place of the one given, one or one a row.
  void set_whitening(const double* whitening, bool shared);
  int64_t rows() const { return rows_; }
  int residual_size() const { return residual_rows(model_, dimension_); }
  // Whitened, in the order of the input; usable once the problem is frozen.
  void residuals(const double* state, double* out) const;
  // Their derivatives -de/dx, whitened: rows x residual_size x 2 most_dof (models.hpp), the rest of each row untouched.
  void jacobians(const double* state, double* out) const;
  // Both, times the root of what the loss makes each row's weight; `out` of the derivatives holds zeros before.
  void weighted(const double* state, double* e, double* J) const;
  // Products with these derivatives WJ, which are never stored. `start` (of the free variables) says where the unknowns
  // of each begin; arrays are row-major with `columns` columns. WJ y, rows x residual_size; and J'W'u, added to `out`.
  void along(const double* state, const int64_t* start, const double* y, int64_t columns, double* out) const;
  void pull(const double* state, const int64_t* start, const double* u, int64_t columns, double* out) const;

  void weigh(std::vector<double>& work) const override;
  void arrange(const std::vector<int32_t>& chunk_of_variable, int32_t chunks) override;
  void couple(Couplings& couplings) override;
  void place(int32_t chunk, Layout& layout) override;
  double linearise(int32_t chunk, const double* state, double* system) const override;
  double slope(int32_t chunk, const double* state, double* system) const override;
  double cost(int32_t chunk, const double* state) const override;
  int64_t fault(const double* state) const override;

 private:
  // Consecutive rows of one chunk between the same kinds of variables.
  struct Run {
    int64_t first, count;
    RowLoops loops;
  };
  Kind kind_of(int64_t row, int key) const;
  int pair_of(int64_t row) const;  // of kinds
  void check_row(int64_t row) const;
  void prepare_measurements();
  void sort_rows(const std::vector<int32_t>& group, int64_t groups);
  Rows rows_of(const Run& run) const;
  // Calls with each row's place in the input, its WJ (residual_size x 2 most_dof), and where the unknowns of each of its
  // columns are, `held` where there is none.
  template <class Use>
  void each_row(const double* state, const int64_t* start, const Use& use) const;

  const Variables& variables_;
  Model model_;
  int dimension_, keys_, numbers_;
  int64_t rows_;
  std::vector<int32_t> index_;
  std::vector<double> z_, whitening_, weights_;
  bool shared_whitening_;
  std::array<RowLoops, kinds * kinds> loops_;  // of every pair of kinds; nulls where the model relates none
  std::vector<double> sensor_, lifted_sensor_;  // as given; in space
  Loss loss_;
  double scale_;

  std::vector<int64_t> order_;  // input row of each row; empty: the same
  std::vector<Run> runs_;
  std::vector<int64_t> chunk_start_;  // runs of each chunk
  std::vector<int64_t> state_a_, state_b_;
  std::vector<int64_t> slots_;  // until placed
  std::vector<Places> places_;
};

// A table by itself, between variables that are all free: its residuals and derivatives may be asked for at once.
struct LoneTable {
  LoneTable(const std::vector<Kind>& kinds, const TableInput& input);
  LoneTable(const LoneTable&) = delete;
  LoneTable& operator=(const LoneTable&) = delete;

  Variables variables;
  Table table;
};

}  // namespace teamslam
