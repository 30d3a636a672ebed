#include "table.hpp"

#include <algorithm>
#include <cstddef>
#include <numbers>
#include <utility>

#include "checks.hpp"

namespace teamslam {

namespace {

constexpr const char* model_names[models] = {"relative_pose", "point",    "range", "bearing",
                                             "range_bearing", "position", "pose",  "corners"};

// rows x width, taken in another order.
template <class Number>
void reorder(std::vector<Number>& rows, int64_t width, const std::vector<int64_t>& order) {
  std::vector<Number> sorted(rows.size());
  for (std::size_t i = 0; i < order.size(); ++i)
    std::copy_n(rows.data() + order[i] * width, width, sorted.data() + static_cast<int64_t>(i) * width);
  rows = std::move(sorted);
}

// The places of variables that are all free.
Variables& fill(Variables& variables) {
  for (int64_t v = 0; v < variables.count(); ++v) {
    variables.offset.push_back(variables.offset.back() + numbers(variables.kind[v]));
    variables.free.push_back(static_cast<int32_t>(v));
  }
  return variables;
}

}  // namespace

Table::Table(const Variables& variables, const TableInput& input)
    : variables_(variables),
      model_(input.model),
      dimension_(input.dimension),
      keys_(keys(input.model)),
      numbers_(measurement_numbers(input.model, input.dimension)),
      rows_(input.rows),
      shared_whitening_(input.shared_whitening),
      loss_(input.loss),
      scale_(input.scale) {
  const char* name = model_names[static_cast<int>(model_)];
  if (rows_ <= 0) refuse(name, ": the table has no rows; leave it out");
  if (loss_ != Loss::squared && !(std::isfinite(scale_) && scale_ > 0.0))
    refuse(name, ": a robust loss needs a scale above zero, found ", scale_);
  for (int64_t i = 0; i < rows_ * keys_; ++i)
    if (input.index[i] < 0 || input.index[i] >= variables.count())
      refuse(name, ": row ", i / keys_, " names variable ", input.index[i], ", but there are ", variables.count());
  index_.assign(input.index, input.index + rows_ * keys_);
  z_.assign(input.z, input.z + rows_ * numbers_);
  set_whitening(input.whitening, input.shared_whitening);
  if (input.sensor) {
    sensor_.assign(input.sensor, input.sensor + pose_numbers(dimension_));
    if (!all_finite(sensor_.data(), pose_numbers(dimension_)) || !is_rotation(sensor_.data() + dimension_, dimension_))
      refuse(name, ": the sensor's pose is not finite or its rotation is none; expected T, then R row by row");
    const std::vector<double>& s = sensor_;
    lifted_sensor_ = dimension_ == 3 ? s : std::vector<double>{s[0], s[1], 0, s[2], s[3], 0, s[4], s[5], 0, 0, 0, 1};
  }
  for (int pair = 0; pair < kinds * kinds; ++pair)
    loops_[pair] = row_loops(model_, dimension_, static_cast<Kind>(pair / kinds), static_cast<Kind>(pair % kinds));
  for (int64_t row = 0; row < rows_; ++row) check_row(row);
  prepare_measurements();
}

Kind Table::kind_of(int64_t row, int key) const { return variables_.kind[index_[keys_ * row + key]]; }

int Table::pair_of(int64_t row) const {
  return static_cast<int>(kind_of(row, 0)) * kinds + (keys_ == 2 ? static_cast<int>(kind_of(row, 1)) : 0);
}

void Table::check_row(int64_t row) const {
  const auto say = [&](const auto&... parts) {
    refuse(model_names[static_cast<int>(model_)], ": row ", row, ": ", parts...);
  };
  const Kind a = kind_of(row, 0), b = keys_ == 2 ? kind_of(row, 1) : a;
  if (!loops_[pair_of(row)].linearise)
    say("cannot relate ", name_of(a), keys_ == 2 ? " to " : "", keys_ == 2 ? name_of(b) : "", " in ", dimension_,
        " dimensions");
  if (keys_ == 2 && index_[2 * row] == index_[2 * row + 1]) say("names variable ", index_[2 * row], " twice");
  if (!sensor_.empty() && !is_pose(a)) say("a sensor's pose needs a pose to sit on, found a ", name_of(a));
  const double* z = z_.data() + row * numbers_;
  if (!all_finite(z, numbers_)) say("the measurement is not finite");
  if ((model_ == Model::relative_pose || model_ == Model::pose) && !is_rotation(z + dimension_, dimension_))
    say("the measured rotation is none; expected T, then R row by row");
  for (int i = 0; i < directions(model_, dimension_); ++i) {
    const double* u = z + (model_ == Model::range_bearing) + 3 * i;
    const double square = u[0] * u[0] + u[1] * u[1] + u[2] * u[2];
    if (!(std::abs(square - 1.0) < rotation_tolerance)) say("the measured direction is not a unit vector");
  }
}

// Directions exactly of unit length, angles in (-pi, pi]: the loops count on it.
void Table::prepare_measurements() {
  const bool angle = dimension_ == 2 && (model_ == Model::bearing || model_ == Model::range_bearing);
  for (int64_t row = 0; row < rows_; ++row) {
    double* z = z_.data() + row * numbers_ + (model_ == Model::range_bearing);
    if (angle) *z = std::remainder(*z, 2.0 * std::numbers::pi);
    for (double* u = z; u < z + 3 * directions(model_, dimension_); u += 3) {
      const double length = std::sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
      for (int i = 0; i < 3; ++i) u[i] /= length;
    }
  }
}

void Table::set_weights(const double* weights) {
  if (!weights) {
    weights_.clear();
    return;
  }
  for (int64_t row = 0; row < rows_; ++row)
    if (!(std::isfinite(weights[row]) && weights[row] >= 0.0))
      refuse("weight of row ", row, " is ", weights[row], "; expected a number of at least 0");
  weights_.assign(weights, weights + rows_);
  if (!order_.empty()) reorder(weights_, 1, order_);
}

void Table::set_whitening(const double* whitening, bool shared) {
  const int64_t width = residual_size() * residual_size(), size = (shared ? 1 : rows_) * width;
  if (!all_finite(whitening, size))
    refuse(model_names[static_cast<int>(model_)], ": the whitening has a number that is not finite");
  whitening_.assign(whitening, whitening + size);
  shared_whitening_ = shared;
  if (!shared && !order_.empty()) reorder(whitening_, width, order_);
}

void Table::weigh(std::vector<double>& work) const {
  const double r = residual_size();
  for (int64_t row = 0; row < rows_; ++row) {
    double columns = 0.0;
    for (int key = 0; key < keys_; ++key) columns += dof(kind_of(row, key));
    work[index_[keys_ * row]] += 50.0 + r * columns * (r + columns);
  }
}

// Rows that come together belong to one observer and one pair of kinds, in the order of the observers.
void Table::sort_rows(const std::vector<int32_t>& group, int64_t groups) {
  bool sorted = true;
  for (int64_t row = 1; row < rows_ && sorted; ++row)
    sorted = group[row - 1] < group[row] ||
             (group[row - 1] == group[row] && index_[keys_ * (row - 1)] <= index_[keys_ * row]);
  if (sorted) return;
  std::vector<int32_t> first_variable(rows_);
  for (int64_t row = 0; row < rows_; ++row) first_variable[row] = index_[keys_ * row];
  order_ = counting_order(group, groups, counting_order(first_variable, variables_.count()));
  reorder(index_, keys_, order_);
  reorder(z_, numbers_, order_);
  if (!shared_whitening_) reorder(whitening_, residual_size() * residual_size(), order_);
  if (!weights_.empty()) reorder(weights_, 1, order_);
}

void Table::arrange(const std::vector<int32_t>& chunk_of_variable, int32_t chunks) {
  constexpr int pairs = kinds * kinds;
  std::vector<int32_t> group(rows_);
  for (int64_t row = 0; row < rows_; ++row)
    group[row] = chunk_of_variable[index_[keys_ * row]] * pairs + pair_of(row);
  sort_rows(group, static_cast<int64_t>(chunks) * pairs);
  if (!order_.empty()) reorder(group, 1, order_);

  chunk_start_.assign(chunks + 1, 0);
  for (int64_t row = 0; row < rows_;) {
    const int32_t here = group[row];
    Run run{row, 0, loops_[pair_of(row)]};
    while (row < rows_ && group[row] == here) ++row;
    run.count = row - run.first;
    runs_.push_back(run);
    ++chunk_start_[here / pairs + 1];
  }
  for (int32_t chunk = 0; chunk < chunks; ++chunk) chunk_start_[chunk + 1] += chunk_start_[chunk];

  state_a_.resize(rows_);
  for (int64_t row = 0; row < rows_; ++row) state_a_[row] = variables_.offset[index_[keys_ * row]];
  if (keys_ == 2) {
    state_b_.resize(rows_);
    for (int64_t row = 0; row < rows_; ++row) state_b_[row] = variables_.offset[index_[2 * row + 1]];
  }
}

void Table::couple(Couplings& couplings) {
  places_.resize(rows_);
  if (keys_ == 1) return;
  slots_.resize(rows_);
  couplings.reserve(rows_);
  for (int64_t row = 0; row < rows_; ++row)
    slots_[row] = couplings.add(variables_.free[index_[2 * row]], variables_.free[index_[2 * row + 1]]);
}

void Table::place(int32_t chunk, Layout& layout) {
  for (int64_t i = chunk_start_[chunk]; i < chunk_start_[chunk + 1]; ++i)
    for (int64_t row = runs_[i].first; row < runs_[i].first + runs_[i].count; ++row) {
      Places& at = places_[row];
      const int32_t a = variables_.free[index_[keys_ * row]];
      at.diagonal_a = layout.diagonal(a);
      at.gradient_a = layout.gradient(a);
      if (keys_ == 1) continue;
      const int32_t b = variables_.free[index_[2 * row + 1]];
      at.diagonal_b = layout.diagonal(b);
      at.gradient_b = layout.gradient(b);
      const int64_t coupling = layout.coupling(slots_[row]);
      at.coupling = a > b ? ~coupling : coupling;
    }
}

Rows Table::rows_of(const Run& run) const {
  const int64_t r = residual_size(), stride = shared_whitening_ ? 0 : r * r;
  const Kind a = kind_of(run.first, 0);
  // The shadow of a pose in space: its sensor sits on it in space (models.hpp).
  const std::vector<double>& sensor = model_ == Model::position && dimension(a) == 3 ? lifted_sensor_ : sensor_;
  return {run.count,
          state_a_.data() + run.first,
          keys_ == 2 ? state_b_.data() + run.first : nullptr,
          z_.data() + run.first * numbers_,
          whitening_.data() + run.first * stride,
          stride,
          sensor.empty() ? nullptr : sensor.data(),
          weights_.empty() ? nullptr : weights_.data() + run.first,
          loss_,
          scale_,
          curvature_,
          places_.empty() ? nullptr : places_.data() + run.first};
}

double Table::linearise(int32_t chunk, const double* state, double* system) const {
  double cost = 0.0;
  for (int64_t i = chunk_start_[chunk]; i < chunk_start_[chunk + 1]; ++i)
    cost += runs_[i].loops.linearise(rows_of(runs_[i]), state, system);
  return cost;
}

double Table::slope(int32_t chunk, const double* state, double* system) const {
  double cost = 0.0;
  for (int64_t i = chunk_start_[chunk]; i < chunk_start_[chunk + 1]; ++i)
    cost += runs_[i].loops.slope(rows_of(runs_[i]), state, system);
  return cost;
}

double Table::cost(int32_t chunk, const double* state) const {
  double cost = 0.0;
  for (int64_t i = chunk_start_[chunk]; i < chunk_start_[chunk + 1]; ++i)
    cost += runs_[i].loops.evaluate(rows_of(runs_[i]), state, nullptr);
  return cost;
}

// Row by row, through the same loops, into room of its own.
int64_t Table::fault(const double* state) const {
  constexpr int64_t block = 36, gradient = 6;
  const Places here{0, 3 * block, block, 3 * block + gradient, 2 * block};
  int64_t first = rows_;
  for (const Run& run : runs_) {
    Rows row = rows_of(run);
    row.count = 1, row.places = &here, row.curvature = Curvature::none;
    for (int64_t i = 0; i < run.count; ++i) {
      double room[3 * block + 2 * gradient] = {};
      room[0] = run.loops.linearise(row, state, room) + room[0];
      if (!all_finite(room, 3 * block + 2 * gradient))
        first = std::min(first, order_.empty() ? run.first + i : order_[run.first + i]);
      ++row.state_a;
      if (row.state_b) ++row.state_b;
      if (row.weight) ++row.weight;
      row.z += numbers_, row.whitening += row.whitening_stride;
    }
  }
  return first < rows_ ? first : -1;
}

void Table::residuals(const double* state, double* out) const {
  const int64_t r = residual_size();
  if (order_.empty()) {
    for (const Run& run : runs_) run.loops.evaluate(rows_of(run), state, out + run.first * r);
    return;
  }
  std::vector<double> whitened(rows_ * r);
  for (const Run& run : runs_) run.loops.evaluate(rows_of(run), state, whitened.data() + run.first * r);
  for (int64_t row = 0; row < rows_; ++row) std::copy_n(whitened.data() + row * r, r, out + order_[row] * r);
}

void Table::jacobians(const double* state, double* out) const {
  const int64_t size = residual_size() * 2 * most_dof;
  std::vector<double> sorted(order_.empty() ? 0 : rows_ * size);
  double* in = order_.empty() ? out : sorted.data();
  for (const Run& run : runs_) run.loops.differentiate(rows_of(run), state, in + run.first * size);
  if (order_.empty()) return;
  for (int64_t row = 0; row < rows_; ++row) std::copy_n(in + row * size, size, out + order_[row] * size);
}

void Table::weighted(const double* state, double* e, double* J) const {
  residuals(state, e);
  jacobians(state, J);
  if (loss_ == Loss::squared) return;
  const int64_t r = residual_size(), size = r * 2 * most_dof;
  for (int64_t row = 0; row < rows_; ++row) {
    double square = 0.0;
    for (int64_t i = 0; i < r; ++i) square += e[row * r + i] * e[row * r + i];
    const double root = std::sqrt(robust(loss_, scale_, square).weight);
    for (int64_t i = 0; i < r; ++i) e[row * r + i] *= root;
    for (int64_t i = 0; i < size; ++i) J[row * size + i] *= root;
  }
}

template <class Use>
void Table::each_row(const double* state, const int64_t* start, const Use& use) const {
  constexpr int64_t together = 64;
  const int64_t size = residual_size() * 2 * most_dof;
  std::vector<double> WJ(together * size);
  std::array<int64_t, 2 * most_dof> unknown{};
  for (const Run& run : runs_) {
    Rows rows = rows_of(run);
    const int dof_a = dof(kind_of(run.first, 0)), dof_b = keys_ == 2 ? dof(kind_of(run.first, 1)) : 0;
    for (int64_t first = 0; first < run.count; first += together) {
      rows.count = std::min(together, run.count - first);
      run.loops.differentiate(rows, state, WJ.data());
      for (int64_t i = 0; i < rows.count; ++i) {
        const int64_t row = run.first + first + i;
        for (int key = 0; key < keys_; ++key) {
          const int32_t free = variables_.free[index_[keys_ * row + key]];
          for (int j = 0; j < (key ? dof_b : dof_a); ++j)
            unknown[(key ? dof_a : 0) + j] = free == held ? held : start[free] + j;
        }
        use(order_.empty() ? row : order_[row], WJ.data() + i * size, unknown.data(), dof_a + dof_b);
      }
      rows.state_a += rows.count;
      if (rows.state_b) rows.state_b += rows.count;
      rows.z += rows.count * numbers_, rows.whitening += rows.count * rows.whitening_stride;
    }
  }
}

void Table::along(const double* state, const int64_t* start, const double* y, int64_t columns, double* out) const {
  const int64_t r = residual_size();
  each_row(state, start, [&](int64_t row, const double* WJ, const int64_t* unknown, int count) {
    for (int64_t i = 0; i < r; ++i) {
      double* sum = out + (row * r + i) * columns;
      std::fill_n(sum, columns, 0.0);
      for (int j = 0; j < count; ++j) {
        if (unknown[j] == held) continue;
        const double slope = WJ[2 * most_dof * i + j];
        const double* of = y + unknown[j] * columns;
        for (int64_t k = 0; k < columns; ++k) sum[k] += slope * of[k];
      }
    }
  });
}

void Table::pull(const double* state, const int64_t* start, const double* u, int64_t columns, double* out) const {
  const int64_t r = residual_size();
  each_row(state, start, [&](int64_t row, const double* WJ, const int64_t* unknown, int count) {
    for (int j = 0; j < count; ++j) {
      if (unknown[j] == held) continue;
      double* sum = out + unknown[j] * columns;
      for (int64_t i = 0; i < r; ++i) {
        const double slope = WJ[2 * most_dof * i + j];
        const double* of = u + (row * r + i) * columns;
        for (int64_t k = 0; k < columns; ++k) sum[k] += slope * of[k];
      }
    }
  });
}

LoneTable::LoneTable(const std::vector<Kind>& kinds, const TableInput& input)
    : variables{kinds, {0}, {}}, table(fill(variables), input) {
  table.arrange(std::vector<int32_t>(kinds.size(), 0), 1);
}

}  // namespace teamslam
