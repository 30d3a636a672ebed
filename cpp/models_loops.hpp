// The loops of models.hpp: load the variables, evaluate, whiten, weigh, scatter. Everything is sized at compile time,
// one instance for every model and pair of kinds.
#pragma once

#include "models.hpp"
#include "models_pose.hpp"
#include "models_sighting.hpp"

#if defined(__GNUC__) || defined(__clang__)
#define TEAMSLAM_FLATTEN __attribute__((flatten))
#define TEAMSLAM_APART __attribute__((noinline))
#else
#define TEAMSLAM_FLATTEN
#define TEAMSLAM_APART
#endif

namespace teamslam {

// A factor says, for one model between variables of kinds `kind_a` (and `kind_b`), how many rows it has and how to
// evaluate
//   e (rows) and, if wanted, J = -de/dx (rows x (dof(A) + dof(B)), row-major, the columns of A first).

// The pose of the sensor that sits on an observer of kind A, and the way back of its Jacobian to the columns of A.
template <int D, Kind A>
struct Observer {
  Pose<D> body, mount, sensor;
  bool mounted;
  Observer(const double* x, const double* mount_numbers) : body(load_pose<D, A>(x)), mounted(mount_numbers != nullptr) {
    if (mounted) {
      mount = load_pose<D, D == 2 ? Kind::pose2 : Kind::pose3>(mount_numbers);
      sensor = compose(body, mount);
    } else {
      sensor = body;
    }
  }
  template <int rows>
  void columns(double* J_sensor, double* J, int stride) const {
    if (mounted) carry_to_body<D, rows>(body, mount, J_sensor);
    for (int i = 0; i < rows; ++i)
      for (int j = 0; j < dof(A); ++j) J[stride * i + j] = J_sensor[pose_dof(D) * i + pose_column(A, D, j)];
  }
};

template <int D, Kind B, int rows>
inline void target_columns(const double* J_point, double* J, int stride) {
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < dof(B); ++j) {
      const int column = point_column(B, D, j);
      J[stride * i + j] = column < 0 ? 0.0 : J_point[D * i + column];
    }
}

template <class Measure, int D, Kind A, Kind B>
struct Sighting {
  static constexpr int rows = Measure::rows, numbers = Measure::numbers, dof_a = dof(A), dof_b = dof(B);
  static constexpr Kind kind_a = A, kind_b = B;
  template <bool with_jacobian>
  static void evaluate(const double* z, const double* mount, const double* a, const double* b, double* e, double* J) {
    const Observer<D, A> observer(a, mount);
    double p[D], J_X[rows * pose_dof(D)], J_p[rows * D];
    load_point<D, B>(b, p);
    sight<Measure, D, with_jacobian>(z, observer.sensor, p, e, J_X, J_p);
    if constexpr (with_jacobian) {
      observer.template columns<rows>(J_X, J, dof_a + dof_b);
      target_columns<D, B, rows>(J_p, J + dof_a, dof_a + dof_b);
    }
  }
};

template <int D, Kind A, Kind B>
struct RelativePose {
  static constexpr int rows = pose_dof(D), numbers = pose_numbers(D), dof_a = dof(A), dof_b = dof(B);
  static constexpr Kind kind_a = A, kind_b = B;
  template <bool with_jacobian>
  static void evaluate(const double* z, const double* mount, const double* a, const double* b, double* e, double* J) {
    const Observer<D, A> observer(a, mount);
    double J_1[rows * rows], J_2[rows * rows];
    relate<D, with_jacobian>(load_pose<D, D == 2 ? Kind::pose2 : Kind::pose3>(z), observer.sensor,
                             load_pose<D, B>(b), e, J_1, J_2);
    if constexpr (with_jacobian) {
      observer.template columns<rows>(J_1, J, dof_a + dof_b);
      for (int i = 0; i < rows; ++i)
        for (int j = 0; j < dof_b; ++j) J[(dof_a + dof_b) * i + dof_a + j] = J_2[rows * i + pose_column(B, D, j)];
    }
  }
};

template <Kind A, Kind B>
struct Corners {
  static constexpr int rows = 8, numbers = 24, dof_a = dof(A), dof_b = dof(B);
  static constexpr Kind kind_a = A, kind_b = B;
  template <bool with_jacobian>
  static void evaluate(const double* z, const double* mount, const double* a, const double* b, double* e, double* J) {
    const Observer<3, A> observer(a, mount);
    double J_1[rows * 6], J_2[rows * 6];
    see_corners<with_jacobian>(z, observer.sensor, load_pose<3, B>(b), e, J_1, J_2);
    if constexpr (with_jacobian) {
      observer.template columns<rows>(J_1, J, dof_a + dof_b);
      for (int i = 0; i < rows; ++i)
        for (int j = 0; j < dof_b; ++j) J[(dof_a + dof_b) * i + dof_a + j] = J_2[6 * i + pose_column(B, 3, j)];
    }
  }
};

template <int D, Kind A>
struct AbsolutePose {
  static constexpr int rows = pose_dof(D), numbers = pose_numbers(D), dof_a = dof(A), dof_b = 0;
  static constexpr Kind kind_a = A, kind_b = A;
  template <bool with_jacobian>
  static void evaluate(const double* z, const double* mount, const double* a, const double*, double* e, double* J) {
    const Observer<D, A> observer(a, mount);
    double J_X[rows * rows];
    locate<D, with_jacobian>(load_pose<D, D == 2 ? Kind::pose2 : Kind::pose3>(z), observer.sensor, e, J_X);
    if constexpr (with_jacobian) observer.template columns<rows>(J_X, J, dof_a);
  }
};

template <int D, Kind A>
struct AbsolutePosition {
  static constexpr int rows = D, numbers = D, dof_a = dof(A), dof_b = 0;
  static constexpr Kind kind_a = A, kind_b = A;
  template <bool with_jacobian>
  static void evaluate(const double* z, const double* mount, const double* a, const double*, double* e, double* J) {
    if constexpr (is_pose(A)) {
      constexpr int space = D > dimension(A) ? D : dimension(A);  // a pose in space whose shadow is measured stays there
      const Observer<space, A> observer(a, mount);
      for (int i = 0; i < D; ++i) e[i] = z[i] - observer.sensor.T[i];
      if constexpr (with_jacobian) {
        double J_X[D * pose_dof(space)];
        for (int i = 0; i < D; ++i)
          for (int k = 0; k < pose_dof(space); ++k) J_X[pose_dof(space) * i + k] = i == k;
        observer.template columns<D>(J_X, J, dof_a);
      }
    } else {
      for (int i = 0; i < D; ++i) {
        e[i] = z[i] - a[i];
        if constexpr (with_jacobian)
          for (int k = 0; k < dof_a; ++k) J[dof_a * i + k] = i == k;
      }
    }
  }
};

// y = W x for `columns` columns, row-major.
template <int rows, int columns>
inline void whiten(const double* W, const double* x, double* y) {
  for (int i = 0; i < rows; ++i) {
    double sum[columns];
    for (int k = 0; k < columns; ++k) sum[k] = W[rows * i] * x[k];
    for (int j = 1; j < rows; ++j)
      for (int k = 0; k < columns; ++k) sum[k] += W[rows * i + j] * x[columns * j + k];
    for (int k = 0; k < columns; ++k) y[columns * i + k] = sum[k];
  }
}

// target (columns_left x columns_right, row-major) += L'R, where L and R are columns of row-major arrays of `rows` rows.
template <int rows, int stride, int columns_left, int columns_right>
inline void add_product(const double* L, const double* R, double* target) {
  for (int i = 0; i < columns_left; ++i) {
    double sum[columns_right];
    for (int j = 0; j < columns_right; ++j) sum[j] = target[columns_right * i + j];
    for (int r = 0; r < rows; ++r)
      for (int j = 0; j < columns_right; ++j) sum[j] += L[stride * r + i] * R[stride * r + j];
    for (int j = 0; j < columns_right; ++j) target[columns_right * i + j] = sum[j];
  }
}

template <int rows, int columns>
inline void add_gradient(const double* J, int stride, const double* e, double* target) {
  for (int j = 0; j < columns; ++j) {
    double sum = 0.0;
    for (int r = 0; r < rows; ++r) sum += J[stride * r + j] * e[r];
    target[j] += sum;
  }
}

// C (columns x columns) -= v v', how the loss bends down along the residual: v = J'e scaled (Triggs et al. 2000, "Bundle
// adjustment", sec. 4.3, without their guard against an indefinite H: whoever factorises it sees that, and asks for
// none). We and WJ carry the root of the weight.
template <int rows, int columns>
inline void subtract_loss_bend(const LossValue& value, double s, double weight, const double* We, const double* WJ,
                               double* C) {
  if (!(value.curvature < 0.0)) return;
  double v[columns] = {};
  add_gradient<rows, columns>(WJ, columns, We, v);
  const double scale = -value.curvature / (s * weight);
  for (int j = 0; j < columns; ++j)
    for (int k = 0; k < columns; ++k) C[columns * j + k] -= scale * v[j] * v[k];
}

// C -= d(J'lambda)/dx, lambda = weight W'We; We carries the root of the weight.
template <class Factor>
void subtract_residual_bend(const Rows& table, int64_t row, const double* state, const double* We, double root,
                            double* C) {
  constexpr int rows = Factor::rows, columns = Factor::dof_a + Factor::dof_b;
  const double *W = table.whitening + row * table.whitening_stride, *z = table.z + row * Factor::numbers;
  double lambda[rows] = {};
  for (int i = 0; i < rows; ++i)
    for (int k = 0; k < rows; ++k) lambda[k] += root * We[i] * W[rows * i + k];
  const auto jacobian_at = [&](const double* a, const double* b, double* J) {
    double e[rows];
    Factor::template evaluate<true>(z, table.sensor, a, b, e, J);
  };
  subtract_bend<rows, columns>(Factor::kind_a, state + table.state_a[row], Factor::kind_b,
                               Factor::dof_b > 0 ? state + table.state_b[row] : nullptr, Factor::dof_a, Factor::dof_b,
                               rows, lambda, jacobian_at, C);
}

// Adds a symmetric C over the unknowns of a row's variables to their blocks (column-major, the rows of the later
// variable fastest).
template <int a, int b>
inline void add_blocks(const double* C, const Places& at, double* system) {
  constexpr int columns = a + b;
  for (int i = 0; i < a; ++i)
    for (int j = 0; j < a; ++j) system[at.diagonal_a + a * i + j] += C[columns * i + j];
  for (int i = 0; i < b; ++i)
    for (int j = 0; j < b; ++j) system[at.diagonal_b + b * i + j] += C[columns * (a + i) + a + j];
  for (int i = 0; i < a; ++i)
    for (int j = 0; j < b; ++j)
      system[at.coupling >= 0 ? at.coupling + b * i + j : ~at.coupling + a * j + i] += C[columns * i + a + j];
}

// How one row's cost bends beyond J'W'WJ. Apart from the loop, whose registers it would take where nobody asks for it.
template <class Factor>
TEAMSLAM_APART void add_curvature(const Rows& table, int64_t row, const double* state, const LossValue& value, double s,
                                  double weight, const double* We, const double* WJ, double* system) {
  constexpr int columns = Factor::dof_a + Factor::dof_b;
  double C[columns * columns] = {};
  subtract_loss_bend<Factor::rows, columns>(value, s, weight, We, WJ, C);
  if (table.curvature == Curvature::all) subtract_residual_bend<Factor>(table, row, state, We, std::sqrt(weight), C);
  add_blocks<Factor::dof_a, Factor::dof_b>(C, table.places[row], system);
}

template <class Factor>
double linearise_rows(const Rows& table, const double* state, double* system) {
  constexpr int rows = Factor::rows, a = Factor::dof_a, b = Factor::dof_b, columns = a + b;
  double cost = 0.0;
  for (int64_t row = 0; row < table.count; ++row) {
    double e[rows], J[rows * columns], We[rows], WJ[rows * columns];
    const double* W = table.whitening + row * table.whitening_stride;
    Factor::template evaluate<true>(table.z + row * Factor::numbers, table.sensor, state + table.state_a[row],
                                    b > 0 ? state + table.state_b[row] : nullptr, e, J);
    whiten<rows, 1>(W, e, We);
    whiten<rows, columns>(W, J, WJ);
    double s = 0.0;
    for (int i = 0; i < rows; ++i) s += We[i] * We[i];
    const LossValue value = robust(table.loss, table.scale, s);
    const double row_weight = table.weight ? table.weight[row] : 1.0, weight = row_weight * value.weight;
    cost += row_weight * value.rho;
    if (weight != 1.0) {  // by its root on both sides, so that H is symmetric to the bit
      const double root = std::sqrt(weight);
      for (int i = 0; i < rows * columns; ++i) WJ[i] *= root;
      for (int i = 0; i < rows; ++i) We[i] *= root;
    }

    const Places& at = table.places[row];
    add_product<rows, columns, a, a>(WJ, WJ, system + at.diagonal_a);
    add_gradient<rows, a>(WJ, columns, We, system + at.gradient_a);
    if constexpr (b > 0) {
      add_product<rows, columns, b, b>(WJ + a, WJ + a, system + at.diagonal_b);
      add_gradient<rows, b>(WJ + a, columns, We, system + at.gradient_b);
      // Blocks are column-major: the rows of the later variable run fastest.
      if (at.coupling >= 0)
        add_product<rows, columns, a, b>(WJ, WJ + a, system + at.coupling);
      else
        add_product<rows, columns, b, a>(WJ + a, WJ, system + ~at.coupling);
    }
    if (table.curvature != Curvature::none && weight > 0.0)
      add_curvature<Factor>(table, row, state, value, s, weight, We, WJ, system);
  }
  return cost;
}

template <class Factor>
double slope_rows(const Rows& table, const double* state, double* system) {
  constexpr int rows = Factor::rows, a = Factor::dof_a, b = Factor::dof_b, columns = a + b;
  double cost = 0.0;
  for (int64_t row = 0; row < table.count; ++row) {
    double e[rows], J[rows * columns], We[rows], pull[rows];
    const double* W = table.whitening + row * table.whitening_stride;
    Factor::template evaluate<true>(table.z + row * Factor::numbers, table.sensor, state + table.state_a[row],
                                    b > 0 ? state + table.state_b[row] : nullptr, e, J);
    whiten<rows, 1>(W, e, We);
    double s = 0.0;
    for (int i = 0; i < rows; ++i) s += We[i] * We[i];
    const LossValue value = robust(table.loss, table.scale, s);
    const double row_weight = table.weight ? table.weight[row] : 1.0, weight = row_weight * value.weight;
    cost += row_weight * value.rho;
    for (int i = 0; i < rows; ++i) {
      pull[i] = 0.0;
      for (int j = 0; j < rows; ++j) pull[i] += weight * W[rows * j + i] * We[j];
    }
    const Places& at = table.places[row];
    add_gradient<rows, a>(J, columns, pull, system + at.gradient_a);
    if constexpr (b > 0) add_gradient<rows, b>(J + a, columns, pull, system + at.gradient_b);
  }
  return cost;
}

template <class Factor>
double evaluate_rows(const Rows& table, const double* state, double* whitened) {
  constexpr int rows = Factor::rows;
  double cost = 0.0;
  for (int64_t row = 0; row < table.count; ++row) {
    double e[rows], We[rows];
    Factor::template evaluate<false>(table.z + row * Factor::numbers, table.sensor, state + table.state_a[row],
                                     Factor::dof_b > 0 ? state + table.state_b[row] : nullptr, e, nullptr);
    whiten<rows, 1>(table.whitening + row * table.whitening_stride, e, We);
    double s = 0.0;
    for (int i = 0; i < rows; ++i) s += We[i] * We[i];
    cost += (table.weight ? table.weight[row] : 1.0) * robust(table.loss, table.scale, s).rho;
    if (whitened)
      for (int i = 0; i < rows; ++i) whitened[rows * row + i] = We[i];
  }
  return cost;
}

template <class Factor>
void differentiate_rows(const Rows& table, const double* state, double* whitened) {
  constexpr int rows = Factor::rows, columns = Factor::dof_a + Factor::dof_b;
  for (int64_t row = 0; row < table.count; ++row) {
    double e[rows], J[rows * columns], WJ[rows * columns];
    Factor::template evaluate<true>(table.z + row * Factor::numbers, table.sensor, state + table.state_a[row],
                                    Factor::dof_b > 0 ? state + table.state_b[row] : nullptr, e, J);
    whiten<rows, columns>(table.whitening + row * table.whitening_stride, J, WJ);
    for (int i = 0; i < rows; ++i)
      for (int j = 0; j < columns; ++j) whitened[2 * most_dof * (rows * row + i) + j] = WJ[columns * i + j];
  }
}

// Small factors have everything that they call built in, so that what is known at compile time (which Jacobians are the
// identity or zero) is known throughout. Large ones would only outgrow the registers.
template <class Factor>
TEAMSLAM_FLATTEN double linearise_rows_flat(const Rows& table, const double* state, double* system) {
  return linearise_rows<Factor>(table, state, system);
}

template <class Factor>
TEAMSLAM_FLATTEN double slope_rows_flat(const Rows& table, const double* state, double* system) {
  return slope_rows<Factor>(table, state, system);
}

template <class Factor>
TEAMSLAM_FLATTEN double evaluate_rows_flat(const Rows& table, const double* state, double* whitened) {
  return evaluate_rows<Factor>(table, state, whitened);
}

template <class Factor>
constexpr RowLoops loops() {
  constexpr bool small = Factor::rows * (Factor::dof_a + Factor::dof_b) <= 18;
  if constexpr (small) {
    return {&linearise_rows_flat<Factor>, &slope_rows_flat<Factor>, &evaluate_rows_flat<Factor>,
            &differentiate_rows<Factor>};
  } else {
    return {&linearise_rows<Factor>, &slope_rows<Factor>, &evaluate_rows<Factor>, &differentiate_rows<Factor>};
  }
}

// Which kinds each model relates. Every instance of the loops is named here.

template <template <int> class Measure>
RowLoops sighting_loops(int D, Kind a, Kind b) {
  using enum Kind;
  if (D == 2 && a == pose2) switch (b) {
      case pose2: return loops<Sighting<Measure<2>, 2, pose2, pose2>>();
      case pose3: return loops<Sighting<Measure<2>, 2, pose2, pose3>>();
      case point2: return loops<Sighting<Measure<2>, 2, pose2, point2>>();
      case point3: return loops<Sighting<Measure<2>, 2, pose2, point3>>();
    }
  if (D == 3 && a == pose2) switch (b) {
      case pose2: return loops<Sighting<Measure<3>, 3, pose2, pose2>>();
      case pose3: return loops<Sighting<Measure<3>, 3, pose2, pose3>>();
      case point3: return loops<Sighting<Measure<3>, 3, pose2, point3>>();
      default: return {};
    }
  if (D == 3 && a == pose3) switch (b) {
      case pose2: return loops<Sighting<Measure<3>, 3, pose3, pose2>>();
      case pose3: return loops<Sighting<Measure<3>, 3, pose3, pose3>>();
      case point3: return loops<Sighting<Measure<3>, 3, pose3, point3>>();
      default: return {};
    }
  return {};
}

inline RowLoops relative_pose_loops(int D, Kind a, Kind b) {
  using enum Kind;
  if (D == 2) return a == pose2 && b == pose2 ? loops<RelativePose<2, pose2, pose2>>() : RowLoops{};
  if (a == pose2 && b == pose2) return loops<RelativePose<3, pose2, pose2>>();
  if (a == pose2 && b == pose3) return loops<RelativePose<3, pose2, pose3>>();
  if (a == pose3 && b == pose2) return loops<RelativePose<3, pose3, pose2>>();
  if (a == pose3 && b == pose3) return loops<RelativePose<3, pose3, pose3>>();
  return {};
}

inline RowLoops corners_loops(int D, Kind a, Kind b) {
  using enum Kind;
  if (D == 2) return {};
  if (a == pose2 && b == pose2) return loops<Corners<pose2, pose2>>();
  if (a == pose2 && b == pose3) return loops<Corners<pose2, pose3>>();
  if (a == pose3 && b == pose2) return loops<Corners<pose3, pose2>>();
  if (a == pose3 && b == pose3) return loops<Corners<pose3, pose3>>();
  return {};
}

inline RowLoops position_loops(int D, Kind a) {
  using enum Kind;
  if (D == 2) switch (a) {
      case pose2: return loops<AbsolutePosition<2, pose2>>();
      case pose3: return loops<AbsolutePosition<2, pose3>>();
      case point2: return loops<AbsolutePosition<2, point2>>();
      case point3: return loops<AbsolutePosition<2, point3>>();
    }
  switch (a) {
    case pose2: return loops<AbsolutePosition<3, pose2>>();
    case pose3: return loops<AbsolutePosition<3, pose3>>();
    case point3: return loops<AbsolutePosition<3, point3>>();
    default: return {};
  }
}

inline RowLoops pose_loops(int D, Kind a) {
  using enum Kind;
  if (D == 2) return a == pose2 ? loops<AbsolutePose<2, pose2>>() : RowLoops{};
  if (a == pose2) return loops<AbsolutePose<3, pose2>>();
  if (a == pose3) return loops<AbsolutePose<3, pose3>>();
  return {};
}

}  // namespace teamslam
