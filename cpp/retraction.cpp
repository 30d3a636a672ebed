#include "retraction.hpp"

#include <algorithm>
#include <utility>

#include "checks.hpp"
#include "lie.hpp"

namespace teamslam {

namespace {

// R <- R Exp(w).
template <int D>
void turn(double* R, const double* w) {
  double step[turn_dof(D)], rotation[D * D], start[D * D], turned[D * D];
  std::copy_n(w, turn_dof(D), step);
  if (std::all_of(step, step + turn_dof(D), [](double angle) { return angle == 0.0; })) return;
  std::copy_n(R, D * D, start);
  exp_rotation(step, rotation);
  multiply<D>(start, rotation, turned);
  sharpen<D>(turned, R);
}

// x <- x (+) d on its own.
void shift(Kind kind, const double* d, double* x) {
  const int D = dimension(kind);
  for (int i = 0; i < D; ++i) x[i] += d[i];
  if (kind == Kind::pose2) turn<2>(x + D, d + D);
  if (kind == Kind::pose3) turn<3>(x + D, d + D);
}

// The step of a pose as one of D dimensions; zero where it is held.
template <int D>
void lift_step(Kind kind, const double* d, double (&lifted)[pose_dof(D)]) {
  std::fill_n(lifted, pose_dof(D), 0.0);
  if (d == nullptr) return;
  for (int j = 0; j < dof(kind); ++j) lifted[pose_column(kind, D, j)] = d[j];
}

// The place y of a thing within its frame, after the step.
template <int D>
void shift_within(const Pose<D>& frame, const double* d_frame, const double* T, const double* d, double (&y)[D]) {
  double ahead[D], turning[D * turn_dof(D)], before[D];
  std::copy_n(T, D, ahead);
  see(frame, ahead, before);
  for (int i = 0; i < D; ++i) ahead[i] += d[i] - d_frame[i];
  see(frame, ahead, y);
  seen_by_turning(before, turning);  // -dw x y, as columns
  for (int i = 0; i < D; ++i)
    for (int k = 0; k < turn_dof(D); ++k) y[i] += turning[turn_dof(D) * i + k] * d_frame[D + k];
}

// The rotation of a pose within its frame, after the step.
template <int D>
void turn_within(const Pose<D>& frame, const double* d_frame, const double* R, const double* d,
                 double (&turned)[D * D]) {
  constexpr int turns = turn_dof(D);
  double own[D * D], relative[D * D], left[turns], rotation[D * D];
  std::copy_n(R, D * D, own);
  multiply_transposed<D>(frame.R, own, relative);
  for (int k = 0; k < turns; ++k) {
    left[k] = d[D + k];
    if constexpr (D == 2) {
      left[k] -= d_frame[D];
    } else {
      for (int i = 0; i < turns; ++i) left[k] -= relative[D * i + k] * d_frame[D + i];
    }
  }
  exp_rotation(left, rotation);
  multiply<D>(relative, rotation, turned);
}

}  // namespace

Retraction::Retraction(const Variables& variables) : variables_(variables), home_(variables.count(), -1) {
  int64_t start = 0;
  for (int64_t v = 0; v < variables.count(); ++v) {
    const bool free = variables.free[v] != held;
    delta_start_.push_back(free ? start : held);
    if (free) order_.push_back(static_cast<int32_t>(v));
    if (free) start += dof(variables.kind[v]);
  }
}

void Retraction::check_home(int64_t variable, int64_t home) const {
  if (home < -1 || home >= variables_.count())
    refuse("the home of variable ", variable, " is ", home, ", but there are ", variables_.count(), " variables");
  if (home >= 0 && !is_pose(variables_.kind[home]))
    refuse("the home of variable ", variable, ", variable ", home, ", is not a pose");
  if (home >= 0 && dimension(variables_.kind[home]) > dimension(variables_.kind[variable]))
    refuse("variable ", variable, " is planar, but its home, variable ", home, ", is in space");
}

void Retraction::set_homes(const int64_t* home) {
  const int64_t count = variables_.count();
  for (int64_t v = 0; v < count; ++v) check_home(v, home[v]);
  enum : char { waiting, passed, done };
  std::vector<char> at(count, waiting);
  std::vector<int32_t> order, way;
  for (int64_t v = 0; v < count; ++v) {
    int64_t up = v;
    for (; up >= 0 && at[up] == waiting; up = home[up]) at[up] = passed, way.push_back(static_cast<int32_t>(up));
    if (up >= 0 && at[up] == passed) refuse("the homes of variable ", up, " lead back to it");
    for (; !way.empty(); way.pop_back()) {
      at[way.back()] = done;
      if (variables_.free[way.back()] != held) order.push_back(way.back());
    }
  }
  std::copy_n(home, count, home_.begin());
  order_ = std::move(order);
}

// A variable of D dimensions, its home already moved.
template <int D>
void Retraction::carry(int32_t variable, const double* state, const double* delta, double* out) const {
  const int32_t home = home_[variable];
  const Kind frame_kind = variables_.kind[home];
  const double* d = delta + delta_start_[variable];
  const double* x = state + variables_.offset[variable];
  double* moved = out + variables_.offset[variable];
  double d_frame[pose_dof(D)], y[D];
  lift_step<D>(frame_kind, delta_start_[home] == held ? nullptr : delta + delta_start_[home], d_frame);
  const Pose<D> before = load_any_pose<D>(frame_kind, state + variables_.offset[home]);
  const Pose<D> after = load_any_pose<D>(frame_kind, out + variables_.offset[home]);
  shift_within<D>(before, d_frame, x, d, y);
  for (int i = 0; i < D; ++i) {
    moved[i] = after.T[i];
    for (int k = 0; k < D; ++k) moved[i] += after.R[D * i + k] * y[k];
  }
  if (!is_pose(variables_.kind[variable])) return;
  double inner[D * D], turned[D * D];
  turn_within<D>(before, d_frame, x + D, d, inner);
  multiply<D>(after.R, inner, turned);
  sharpen<D>(turned, moved + D);
}

void Retraction::move(const double* state, const double* delta, double* out) const {
  std::copy_n(state, variables_.numbers(), out);
  for (int32_t v : order_) {
    const Kind kind = variables_.kind[v];
    if (home_[v] < 0)
      shift(kind, delta + delta_start_[v], out + variables_.offset[v]);
    else if (dimension(kind) == 2)
      carry<2>(v, state, delta, out);
    else
      carry<3>(v, state, delta, out);
  }
}

}  // namespace teamslam
