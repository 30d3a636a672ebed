// Triangular solves with the factor, and the Schur complement onto the last variables.
//
// One right-hand side goes through every panel alone. Several are taken eight at a time, the eight values of a scalar
// side by side as they are given, so that the same kernels as in the factorisation run over them and rows are gathered
// by cache line; one that is left over goes alone.
#include <algorithm>
#include <cstring>

#include "cholesky_numeric.hpp"

namespace teamslam {
namespace {

constexpr int64_t wide = 8;

// Passes through the first fronts over y, `width` values for each elimination-order scalar.
template <int64_t width>
class Sweep {
 public:
  Sweep(const Symbolic& s, const double* panel, const double* inverse)
      : s_(s), panel_(panel), inverse_(inverse), dense_(dense_kernels()),
        t_(static_cast<size_t>(padded(s.largest_front) * width)) {}

  void forward(double* y, size_t fronts) {
    double* t = t_.data();
    for (size_t f = 0; f < fronts; ++f) {
      const Front& front = s_.front[f];
      const double* d = panel_ + front.panel;
      const double* l = d + front.below();
      double* x = y + front.first_scalar * width;
      const double* inverse = inverse_ + front.first_scalar;
      if constexpr (width == 1) {
        dense_.forward_one(front.columns, front.leading_rows(), d, front.leading_pivot(), l, front.leading_rows(),
                           inverse, x, t);
      } else {
        dense_.divide_transposed(width, front.columns, d, front.leading_pivot(), inverse, x, width);
        std::fill_n(t, front.rows * width, 0.0);
        dense_.subtract_product(width, front.rows, front.columns, x, width, l, front.leading_rows(), 1, t, width);
      }
      const int32_t* row = s_.row_scalar.data() + front.row_start;
      for (int64_t i = 0; i < front.rows; ++i) {
        for (int64_t c = 0; c < width; ++c) y[row[i] * width + c] += t[i * width + c];
      }
    }
  }

  void backward(double* y, size_t fronts) {
    double* t = t_.data();
    for (size_t f = fronts; f-- > 0;) {
      const Front& front = s_.front[f];
      const double* d = panel_ + front.panel;
      const double* l = d + front.below();
      double* x = y + front.first_scalar * width;
      const double* inverse = inverse_ + front.first_scalar;
      const int32_t* row = s_.row_scalar.data() + front.row_start;
      for (int64_t i = 0; i < front.rows; ++i) {
        for (int64_t c = 0; c < width; ++c) t[i * width + c] = y[row[i] * width + c];
      }
      if constexpr (width == 1) {
        for (int64_t i = front.rows; i < front.leading_rows(); ++i) t[i] = 0;
        dense_.backward_one(front.columns, front.leading_rows(), d, front.leading_pivot(), l, front.leading_rows(),
                            inverse, x, t);
      } else {
        dense_.subtract_product(width, front.columns, front.rows, t, width, l, 1, front.leading_rows(), x, width);
        dense_.divide(width, front.columns, d, front.leading_pivot(), inverse, x, width);
      }
    }
  }

 private:
  const Symbolic& s_;
  const double* panel_;
  const double* inverse_;
  const DenseKernels& dense_;
  std::vector<double> t_;
};

enum class Order { natural, eliminated };  // in which columns are given, and in which results are written

// Calls body(sweep, y) on some of the columns of rhs, in the order of elimination, in groups of `width`, and writes y
// back.
template <int64_t width, class Body>
void over_groups(const Symbolic& s, const double* panel, const double* inverse, double* rhs, int64_t first,
                 int64_t end, int64_t columns, Order given, Order result, const Body& body) {
  const auto place = [&s](Order order, int64_t i) { return order == Order::natural ? s.natural_scalar[i] : i; };
  Sweep<width> sweep(s, panel, inverse);
  std::vector<double> y(static_cast<size_t>(s.scalars * width), 0.0);
  for (int64_t c0 = first; c0 < end; c0 += width) {
    const int64_t count = std::min(width, end - c0);
    double* group = rhs + c0;
    for (int64_t i = 0; i < s.scalars; ++i) {
      std::copy_n(group + place(given, i) * columns, count, y.data() + i * width);
      std::fill_n(y.data() + i * width + count, width - count, 0.0);
    }
    body(sweep, y.data());
    for (int64_t i = 0; i < s.scalars; ++i)
      std::copy_n(y.data() + i * width, count, group + place(result, i) * columns);
  }
}

template <class Body>
void over_columns(const Symbolic& s, const double* panel, const double* inverse, double* rhs, int64_t columns,
                  Order given, Order result, const Body& body) {
  const int64_t alone = columns % wide == 1 ? columns - 1 : columns;
  if (alone > 0) over_groups<wide>(s, panel, inverse, rhs, 0, alone, columns, given, result, body);
  if (alone < columns) over_groups<1>(s, panel, inverse, rhs, alone, columns, columns, given, result, body);
}

}  // namespace

void Cholesky::solve(double* rhs, int64_t columns) const {
  const size_t fronts = symbolic_->front.size();
  over_columns(*symbolic_, numeric_->panel.get(), numeric_->inverse.data(), rhs, columns, Order::natural,
               Order::natural, [&](auto& sweep, double* y) {
                 sweep.forward(y, fronts);
                 sweep.backward(y, fronts);
               });
}

void Cholesky::solve_lower(double* rhs, int64_t columns) const {
  over_columns(*symbolic_, numeric_->panel.get(), numeric_->inverse.data(), rhs, columns, Order::natural,
               Order::eliminated, [&](auto& sweep, double* y) { sweep.forward(y, symbolic_->front.size()); });
}

void Cholesky::solve_upper(double* rhs, int64_t columns) const {
  over_columns(*symbolic_, numeric_->panel.get(), numeric_->inverse.data(), rhs, columns, Order::eliminated,
               Order::natural, [&](auto& sweep, double* y) { sweep.backward(y, symbolic_->front.size()); });
}

int32_t Cholesky::eliminate(const double* values, const double* damping, double* complement, const double* rhs,
                            double* reduced_rhs) {
  const Symbolic& s = *symbolic_;
  const int64_t m = s.last_scalars;
  const int32_t failed = run(values, damping, m > 0);
  if (failed >= 0 || m == 0) return failed;
  const Front& last = s.front.back();
  const double* d = numeric_->panel.get() + last.panel;
  for (int64_t j = 0; j < m; ++j) {
    for (int64_t i = j; i < m; ++i) complement[i + j * m] = complement[j + i * m] = d[i + j * last.leading_pivot()];
  }
  if (rhs == nullptr) return failed;
  std::vector<double> y(rhs, rhs + s.scalars);
  over_columns(s, numeric_->panel.get(), numeric_->inverse.data(), y.data(), 1, Order::natural,
               Order::eliminated, [&](auto& sweep, double* x) { sweep.forward(x, s.front.size() - 1); });
  std::copy(y.begin() + (s.scalars - m), y.end(), reduced_rhs);
  return failed;
}

void Cholesky::back_substitute(const double* last_solution, double* rhs_inout) const {
  const Symbolic& s = *symbolic_;
  const size_t interiors = s.front.size() - (s.last_scalars > 0 ? 1 : 0);
  over_columns(s, numeric_->panel.get(), numeric_->inverse.data(), rhs_inout, 1, Order::natural,
               Order::natural, [&](auto& sweep, double* y) {
                 sweep.forward(y, interiors);
                 std::copy(last_solution, last_solution + s.last_scalars, y + (s.scalars - s.last_scalars));
                 sweep.backward(y, interiors);
               });
}

}  // namespace teamslam
