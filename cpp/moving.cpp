#include "moving.hpp"

#include <algorithm>

#include "checks.hpp"
#include "lie.hpp"

namespace teamslam {

namespace {

// Exp(w), or the identity where there is no w.
template <int D>
void exp_of(const double* w, double scale, double (&R)[D * D]) {
  double step[turn_dof(D)];
  for (int k = 0; k < turn_dof(D); ++k) step[k] = w ? scale * w[k] : 0.0;
  exp_rotation(step, R);
}

// R <- R Exp(u).
template <int E>
void turn_by(double* R, const double* u) {
  if (std::all_of(u, u + turn_dof(E), [](double angle) { return angle == 0.0; })) return;
  double before[E * E], step[E * E], after[E * E];
  std::copy_n(R, E * E, before);
  exp_of<E>(u, 1.0, step);
  multiply<E>(before, step, after);
  std::copy_n(after, E * E, R);
}

// The place and the rotation of a variable of E dimensions turned about a centre.
template <int D>
void turn_about(const double (&turn)[D * D], const double* centre, Kind kind, double* x) {
  double from[D];
  for (int i = 0; i < D; ++i) from[i] = x[i] - centre[i];
  for (int i = 0; i < D; ++i) {
    x[i] = centre[i];
    for (int k = 0; k < D; ++k) x[i] += turn[D * i + k] * from[k];
  }
  if (!is_pose(kind)) return;
  const int E = dimension(kind);
  double* R = x + E;
  for (int j = 0; j < E; ++j) {
    double column[D];
    for (int k = 0; k < D; ++k) column[k] = R[E * k + j];
    for (int i = 0; i < D; ++i) {
      R[E * i + j] = 0.0;
      for (int k = 0; k < D; ++k) R[E * i + j] += turn[D * i + k] * column[k];
    }
  }
}

template <int D>
void retract_all(const Moving& order, const double* centre, const double* delta, double* x) {
  double half[D * D], turn[D * D];
  exp_of<D>(order.turns[0] ? delta + D : nullptr, 0.5, half);
  multiply<D>(half, half, turn);
  for (int64_t v = 0; v < order.count(); ++v) {
    const Kind kind = order.kind[v];
    const int E = dimension(kind);
    const double* d = delta + order.unknown[v];
    double* at = x + order.number[v];
    if (order.turns[v]) {
      turn_about<D>(turn, centre, kind, at);
      for (int i = 0; i < D; ++i)
        for (int k = 0; k < D; ++k) at[i] += half[D * i + k] * d[k];
      for (int i = D; i < E; ++i) at[i] += d[i];
    } else {
      for (int i = 0; i < E; ++i) at[i] += d[i];
    }
    if (!is_pose(kind) || (v == 0 && order.turns[0])) continue;  // the turn of the pose of now is that of all
    if (E == 2)
      turn_by<2>(at + E, d + E);
    else
      turn_by<3>(at + E, d + E);
  }
}

}  // namespace

template <int D>
void turning_of(Kind kind, const double* x, const double* centre, double* out) {
  constexpr int axes = turn_dof(D);
  double from[D], moved[D * axes];
  for (int i = 0; i < D; ++i) from[i] = x[i] - centre[i];
  seen_by_turning(from, moved);  // of Exp(-w)
  std::fill_n(out, dof(kind) * axes, 0.0);
  for (int i = 0; i < D * axes; ++i) out[i] = -moved[i];
  if (!is_pose(kind)) return;
  const int E = dimension(kind);
  const double* R = x + E;
  double* turned = out + E * axes;
  if (E == 2) {
    turned[0] = 1.0;
  } else {  // R' of the axes: those of space, or the upright one
    for (int i = 0; i < 3; ++i)
      for (int k = 0; k < axes; ++k) turned[axes * i + k] = R[3 * (D == 2 ? 2 : k) + i];
  }
}
template void turning_of<2>(Kind, const double*, const double*, double*);
template void turning_of<3>(Kind, const double*, const double*, double*);

Moving::Moving(int64_t count, const int32_t* kinds, const uint8_t* turning, const double* centre)
    : kind(count), turns(turning, turning + count), number(count + 1), unknown(count + 1), centre_{} {
  if (count < 1 || kinds[0] < 0 || kinds[0] > 1) refuse("a filter's first variable is a pose");
  dimension = kinds[0] == static_cast<int32_t>(Kind::pose2) ? 2 : 3;
  std::copy_n(centre, dimension, centre_);
  for (int64_t v = 0; v < count; ++v) {
    if (kinds[v] < 0 || kinds[v] >= teamslam::kinds)
      refuse("variable ", v, " is of kind ", kinds[v], "; expected 0 to 3");
    kind[v] = static_cast<Kind>(kinds[v]);
    if (turns[v] && teamslam::dimension(kind[v]) < dimension)
      refuse("variable ", v, " is planar and cannot turn with a pose in space");
    number[v + 1] = number[v] + teamslam::numbers(kind[v]);
    unknown[v + 1] = unknown[v] + dof(kind[v]);
  }
}

void Moving::turning(const double* state, double* out) const {
  std::fill_n(out, unknowns() * axes(), 0.0);
  for (int64_t v = 0; v < count(); ++v) {
    if (!turns[v]) continue;
    const double* x = state + number[v];
    double* of = out + unknown[v] * axes();
    if (dimension == 2)
      turning_of<2>(kind[v], x, centre_, of);
    else
      turning_of<3>(kind[v], x, centre_, of);
  }
}

void Moving::retract(const double* state, const double* delta, double* out) const {
  std::copy_n(state, numbers(), out);
  if (dimension == 2)
    retract_all<2>(*this, centre_, delta, out);
  else
    retract_all<3>(*this, centre_, delta, out);
}

}  // namespace teamslam
