#include "filter.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "checks.hpp"
#include "dense.hpp"
#include "lie.hpp"

namespace teamslam {

namespace {

using Numbers = std::vector<double>;

constexpr int width = 2 * most_dof;  // of a row of J

int64_t padded(int64_t count) { return (count + 3) & ~int64_t{3}; }

// y += a x.
void add(int64_t count, double a, const double* x, double* y) {
  for (int64_t i = 0; i < count; ++i) y[i] += a * x[i];
}

double dot(int64_t count, const double* x, const double* y) {
  double sum = 0.0;
  for (int64_t i = 0; i < count; ++i) sum += x[i] * y[i];
  return sum;
}

// The other triangle of a symmetric matrix of which row i has all from column i on; in tiles, which stay in the cache.
void mirror(int64_t n, double* P) {
  constexpr int64_t tile = 16;
  for (int64_t i0 = 0; i0 < n; i0 += tile)
    for (int64_t j0 = i0; j0 < n; j0 += tile)
      for (int64_t i = i0; i < std::min(i0 + tile, n); ++i)
        for (int64_t j = std::max(j0, i + 1); j < std::min(j0 + tile, n); ++j) P[j * n + i] = P[i * n + j];
}

// Rows in the filter's unknowns: those of the pose of now, which turn all that turns, stand by themselves.
class Turned {
 public:
  Turned(const Moving& order, const Sightings& rows)
      : order_(order), rows_(rows), e(rows.numbers()), J(rows.numbers() * width), own_(rows.numbers() * order.own()),
        turning_(order.unknowns() * order.axes()) {}

  bool at(const double* state) {
    std::fill(J.begin(), J.end(), 0.0);
    rows_.linearise(state, e.data(), J.data());
    if (!all_finite(e.data(), rows_.numbers()) || !all_finite(J.data(), rows_.numbers() * width)) return false;
    order_.turning(state, turning_.data());
    for (int64_t i = 0; i < rows_.numbers(); ++i) turn(i);
    return true;
  }

  // sum_j J_ij x_j, and y += sum_j J_ij x_j, x_j vectors of `count` numbers, `leading` apart.
  double along(int64_t i, const double* x) const {
    double sum = dot(order_.own(), own(i), x);
    each(i, [&](int64_t v, const double* slope) {
      if (v > 0) sum += dot(dof(order_.kind[v]), slope, x + order_.unknown[v]);
    });
    return sum;
  }
  void combine(int64_t i, const double* x, int64_t leading, int64_t count, double* y) const {
    for (int j = 0; j < order_.own(); ++j) add(count, own(i)[j], x + j * leading, y);
    each(i, [&](int64_t v, const double* slope) {
      if (v == 0) return;
      for (int j = 0; j < dof(order_.kind[v]); ++j) add(count, slope[j], x + (order_.unknown[v] + j) * leading, y);
    });
  }

 private:
  const double* own(int64_t i) const { return own_.data() + i * order_.own(); }
  // Calls with the variables of residual i and its derivatives by each.
  template <class Use>
  void each(int64_t i, const Use& use) const {
    const int64_t* v = rows_.index + i / rows_.residuals * rows_.keys;
    const double* slope = J.data() + i * width;
    use(v[0], slope);
    if (rows_.keys == 2) use(v[1], slope + dof(order_.kind[v[0]]));
  }
  void turn(int64_t i) {
    const int axes = order_.axes(), d = order_.dimension;
    double* lead = own_.data() + i * order_.own();
    std::fill_n(lead, order_.own(), 0.0);
    each(i, [&](int64_t v, const double* slope) {
      if (v == 0) std::copy_n(slope, d, lead);
      const double* turning = turning_.data() + order_.unknown[v] * axes;
      for (int j = 0; j < dof(order_.kind[v]); ++j) add(axes, slope[j], turning + j * axes, lead + d);
    });
  }

  const Moving& order_;
  const Sightings& rows_;

 public:
  Numbers e, J;

 private:
  Numbers own_, turning_;
};

// S = 1 + J P J' in its lower factor, column-major; `across` = P J', a column for each residual.
class Innovation {
 public:
  Innovation(int64_t residuals, int64_t unknowns)
      : m_(residuals), n_(unknowns), high_(padded(unknowns)), leading_(padded(residuals)), across_(high_ * m_),
        S_(leading_ * leading_), inverse_(m_), lowest_(m_) {}

  bool of(const Turned& rows, const double* P) {
    std::fill(across_.begin(), across_.end(), 0.0);
    std::fill(S_.begin(), S_.end(), 0.0);
    for (int64_t i = 0; i < m_; ++i) rows.combine(i, P, n_, n_, across(i));
    for (int64_t j = 0; j < m_; ++j)
      for (int64_t i = j; i < m_; ++i) S_[i + j * leading_] = rows.along(i, across(j)) + (i == j);
    return dense_kernels().factor(m_, S_.data(), leading_, lowest_.data(), inverse_.data()) < 0;
  }

  // P J' S^-1 y.
  void gain(Numbers& y, double* shift) const {
    for (int64_t j = 0; j < m_; ++j) {
      y[j] *= inverse_[j];
      add(m_ - j - 1, -y[j], column(j) + j + 1, y.data() + j + 1);
    }
    for (int64_t j = m_ - 1; j >= 0; --j)
      y[j] = (y[j] - dot(m_ - j - 1, column(j) + j + 1, y.data() + j + 1)) * inverse_[j];
    std::fill_n(shift, n_, 0.0);
    for (int64_t i = 0; i < m_; ++i) add(n_, y[i], across_.data() + i * high_, shift);
  }

  // P - P J' S^-1 J P.
  void sharpen(const double* P, double* out) {
    const DenseKernels& dense = dense_kernels();
    dense.divide_transposed(high_, m_, S_.data(), leading_, inverse_.data(), across_.data(), high_);
    Numbers room(high_ == n_ ? 0 : high_ * high_);
    double* C = room.empty() ? out : room.data();
    for (int64_t j = 0; j < n_; ++j) std::copy_n(P + j * n_ + j, n_ - j, C + j * high_ + j);
    dense.subtract_square(high_, m_, across_.data(), high_, C, high_, 0, high_);
    if (C != out)
      for (int64_t j = 0; j < n_; ++j) std::copy_n(C + j * high_ + j, n_ - j, out + j * n_ + j);
    mirror(n_, out);
  }

 private:
  double* across(int64_t i) { return across_.data() + i * high_; }
  const double* column(int64_t j) const { return S_.data() + j * leading_; }

  int64_t m_, n_, high_, leading_;
  Numbers across_, S_, inverse_, lowest_;
};

// Whether a movement turns the pose of now, or the sight of what the rows see, by more than a little.
bool turns_sight(const Moving& order, const Sightings& rows, const double* state, const double* ahead, double little) {
  const int d = order.dimension, n = order.own();
  const auto largest = [&](int64_t from, int64_t count) {
    double most = 0.0;
    for (int64_t i = from; i < from + count; ++i) most = std::max(most, std::abs(ahead[i]));
    return most;
  };
  if (largest(d, n - d) > little) return true;
  double away = -1.0, others = 0.0;
  for (int64_t i = 0; i < rows.rows * rows.keys; ++i) {
    const int64_t v = rows.index[i];
    if (v == 0) continue;
    const double* x = state + order.number[v];
    const double distance = std::abs(x[0] - state[0]) + std::abs(x[1] - state[1]);
    away = away < 0.0 ? distance : std::min(away, distance);
    others = std::max(others, largest(order.unknown[v], dof(order.kind[v])));
  }
  return away >= 0.0 && largest(0, d) + others > little * away;
}

// D^-1 by the Cholesky factor of its correlations; false where it is not positive but for rounding.
bool inverse_of(int n, const double* D, double* Q) {
  double scale[most_dof], L[most_dof * most_dof] = {}, root[most_dof * most_dof] = {};
  for (int i = 0; i < n; ++i) {
    if (!(D[n * i + i] > 0.0)) return false;
    scale[i] = std::sqrt(D[n * i + i]);
  }
  for (int i = 0; i < n; ++i)
    for (int j = 0; j <= i; ++j) {
      double sum = D[n * i + j] / (scale[i] * scale[j]);
      for (int k = 0; k < j; ++k) sum -= L[n * i + k] * L[n * j + k];
      if (i == j && !(sum > 1e-14)) return false;
      L[n * i + j] = i == j ? std::sqrt(sum) : sum / L[n * j + j];
    }
  for (int j = 0; j < n; ++j)  // root = L^-1 / scale
    for (int i = j; i < n; ++i) {
      double sum = i == j;
      for (int k = j; k < i; ++k) sum -= L[n * i + k] * root[n * k + j];
      root[n * i + j] = sum / L[n * i + i];
    }
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      Q[n * i + j] = 0.0;
      for (int k = std::max(i, j); k < n; ++k) Q[n * i + j] += root[n * k + i] * root[n * k + j];
      Q[n * i + j] /= scale[i] * scale[j];
    }
  return true;
}

// C = A B, n x n.
void product(int n, const double* A, const double* B, double* C) {
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      C[n * i + j] = 0.0;
      for (int k = 0; k < n; ++k) C[n * i + j] += A[n * i + k] * B[n * k + j];
    }
}

void transpose(int n, const double* A, double* B) {
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) B[n * j + i] = A[n * i + j];
}

// How a pose that turns by so much (own x axes) moves in the mixed chart with its unknowns in the filter, and back.
void charted(int d, int n, const double* turning, double* out) {
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) out[n * i + j] = j < d ? i == j : turning[(n - d) * i + j - d];
}
void uncharted(int d, int n, const double* turning, double* out) {  // its last rows are a rotation
  const int axes = n - d;
  std::fill_n(out, n * n, 0.0);
  for (int i = 0; i < d; ++i) {
    out[n * i + i] = 1.0;
    for (int j = 0; j < axes; ++j)
      for (int k = 0; k < axes; ++k) out[n * i + d + j] -= turning[axes * i + k] * turning[axes * (d + j) + k];
  }
  for (int i = 0; i < axes; ++i)
    for (int j = 0; j < axes; ++j) out[n * (d + i) + d + j] = turning[axes * (d + j) + i];
}

// Of the new pose given the old one, from rows between them: F and Q in the mixed chart, and the way to its best place.
struct Step {
  double F[most_dof * most_dof], Q[most_dof * most_dof], shift[most_dof];
};
bool step_of(int n, const Sightings& steps, const double* pair, Step& step) {
  Numbers e(steps.numbers()), J(steps.numbers() * width);
  steps.linearise(pair, e.data(), J.data());
  if (!all_finite(e.data(), steps.numbers()) || !all_finite(J.data(), steps.numbers() * width)) return false;
  double D[most_dof * most_dof] = {}, B[most_dof * most_dof] = {}, g[most_dof] = {};
  for (int64_t r = 0; r < steps.numbers(); ++r) {
    const bool forward = steps.index[r / steps.residuals * 2] == 0;
    const double *before = J.data() + r * width + (forward ? 0 : n), *after = J.data() + r * width + (forward ? n : 0);
    for (int i = 0; i < n; ++i) {
      add(n, after[i], after, D + n * i);
      add(n, after[i], before, B + n * i);
      g[i] += after[i] * e[r];
    }
  }
  if (!inverse_of(n, D, step.Q)) return false;
  product(n, step.Q, B, step.F);
  for (int i = 0; i < n; ++i) step.shift[i] = dot(n, step.Q + n * i, g);
  for (double& f : step.F) f = -f;
  return true;
}

// X o step, or X o step^-1.
template <int D>
void compose_to(const double* x, const double* step, bool backward, double* out) {
  constexpr Kind kind = D == 2 ? Kind::pose2 : Kind::pose3;
  Pose<D> ahead = load_pose<D, kind>(step);
  if (backward) {
    constexpr double origin[D] = {};
    Pose<D> back;
    see(ahead, origin, back.T);
    for (int i = 0; i < D; ++i)
      for (int j = 0; j < D; ++j) back.R[D * i + j] = ahead.R[D * j + i];
    ahead = back;
  }
  const Pose<D> X = compose(load_pose<D, kind>(x), ahead);
  std::copy_n(X.T, D, out), std::copy_n(X.R, D * D, out + D);
}

template <int D>
void placed(Kind kind, const double* start, const double* shift, double* out) {
  const Moving alone(1, std::array{static_cast<int32_t>(kind)}.data(), std::array<uint8_t, 1>{0}.data(),
                     std::array<double, D>{}.data());
  double R[D * D];
  alone.retract(start, shift, out);
  std::copy_n(out + D, D * D, R);
  sharpen<D>(R, out + D);
}

void check_turns(const Moving& order) {
  if (!order.turns[0]) refuse("what turns, turns with the pose of now: that turns too");
}

}  // namespace

bool moved(const Moving& order, const Gaussian& given, const Sightings& steps, const double* measured, bool backward,
           bool settled, double* state, double* covariance) {
  check_turns(order);
  const int n = order.own(), d = order.dimension, axes = order.axes();
  const int64_t N = order.unknowns(), own_numbers = teamslam::numbers(order.kind[0]);
  Numbers pair(2 * own_numbers);
  double* start = pair.data() + own_numbers;
  std::copy_n(given.state, own_numbers, pair.data());
  (d == 2 ? compose_to<2> : compose_to<3>)(given.state, measured, backward, start);
  Step step;
  if (!step_of(n, steps, pair.data(), step)) return false;
  if (settled) std::fill_n(step.shift, n, 0.0);
  std::copy_n(given.state, order.numbers(), state);
  (d == 2 ? placed<2> : placed<3>)(order.kind[0], start, step.shift, state);

  // In the filter's unknowns. What turns is where it was: where the pose has turned, it has not turned along.
  Numbers before(N * axes), turning(N * axes);
  order.turning(given.state, before.data());
  order.turning(state, turning.data());
  double chart[most_dof * most_dof], back[most_dof * most_dof], back_t[most_dof * most_dof], F[most_dof * most_dof],
      Q[most_dof * most_dof], part[most_dof * most_dof];
  charted(d, n, before.data(), chart);
  uncharted(d, n, turning.data(), back);
  transpose(n, back, back_t);
  product(n, back, step.F, part), product(n, part, chart, F);
  product(n, back, step.Q, part), product(n, part, back_t, Q);

  // P + O P_n + P_n' O' + O P_nn O' + E Q E' with O (`by_old`) and E (`by_noise`) of N x n, as
  // P + [O M EQ] [M O E]',  M = P_n' + O P_nn / 2.
  std::vector<int64_t> turns;
  for (int64_t v = 0; v < order.count(); ++v)
    if (v == 0 || order.turns[v])
      for (int64_t i = order.unknown[v]; i < order.unknown[v + 1]; ++i) turns.push_back(i);
  const double* P = given.covariance;
  Numbers O(N * n), E(N * n);
  for (int64_t i : turns) {
    double *by_old = O.data() + i * n, *by_noise = E.data() + i * n;
    const double* turn = turning.data() + i * axes;
    if (i < n) {
      std::copy_n(F + n * i, n, by_old);
      by_old[i] -= 1.0, by_noise[i] = 1.0;
      continue;
    }
    for (int a = 0; a < axes; ++a) {
      add(n, -turn[a], F + n * (d + a), by_old);
      by_old[d + a] += turn[a], by_noise[d + a] = -turn[a];
    }
  }
  Numbers left(3 * n), right(3 * n * N);  // of one row; of all columns, transposed
  for (int64_t j = 0; j < N; ++j)
    for (int k = 0; k < n; ++k) {
      double M = P[k * N + j];
      for (int l = 0; l < n; ++l) M += 0.5 * O[j * n + l] * P[l * N + k];
      right[k * N + j] = M, right[(n + k) * N + j] = O[j * n + k], right[(2 * n + k) * N + j] = E[j * n + k];
    }
  std::copy_n(P, N * N, covariance);
  for (int64_t i : turns) {
    for (int k = 0; k < n; ++k) {
      left[k] = O[i * n + k], left[n + k] = right[k * N + i], left[2 * n + k] = 0.0;
      for (int l = 0; l < n; ++l) left[2 * n + k] += E[i * n + l] * Q[n * l + k];
    }
    for (int k = 0; k < 3 * n; ++k) add(N, left[k], right.data() + k * N, covariance + i * N);
  }
  for (int64_t i : turns)
    for (int64_t j = 0; j < N; ++j) covariance[j * N + i] = covariance[i * N + j];
  return true;
}

bool seen(const Moving& order, const Gaussian& given, const Sightings& rows, int64_t most, double little, double* state,
          double* covariance) {
  check_turns(order);
  const int64_t N = order.unknowns(), m = rows.numbers();
  Turned turned(order, rows);
  Innovation innovation(m, N);
  Numbers shift(N), before(N), ahead(N), y(m);
  std::copy_n(given.state, order.numbers(), state);
  for (int64_t n = 0; n < most; ++n) {
    if (!turned.at(state) || !innovation.of(turned, given.covariance)) return false;
    for (int64_t i = 0; i < m; ++i) y[i] = turned.e[i] + turned.along(i, shift.data());
    before.swap(shift);
    innovation.gain(y, shift.data());
    order.retract(given.state, shift.data(), state);
    for (int64_t i = 0; i < N; ++i) ahead[i] = shift[i] - before[i];
    if (!turns_sight(order, rows, given.state, ahead.data(), little)) break;
  }
  innovation.sharpen(given.covariance, covariance);
  return true;
}

}  // namespace teamslam
