// Triangular solves with the factor, and the Schur complement onto the last variables.
//
// One right-hand side goes through every panel alone. Several are taken eight at a time, the eight values of a scalar
// side by side, so that the same kernels as in the factorisation run over them and rows are gathered by cache line.
#include <algorithm>
#include <cstring>

#include "cholesky_numeric.hpp"

namespace teamslam {
namespace {

constexpr int64_t wide = 8;

// Passes through the fronts first .. end over y, `width` values for each elimination-order scalar.
class Sweep {
 public:
  Sweep(const Symbolic& s, const double* panel, const double* inverse, int64_t width)
      : s_(s), panel_(panel), inverse_(inverse), width_(width), dense_(dense_kernels()),
        t_(static_cast<size_t>(padded(s.largest_front) * width)) {}

  void forward(double* y, size_t fronts) {
    for (size_t f = 0; f < fronts; ++f) {
      const Front& front = s_.front[f];
      const double* d = panel_ + front.panel;
      const double* l = d + front.below();
      double* x = y + front.first_scalar * width_;
      const double* inverse = inverse_ + front.first_scalar;
      if (width_ == 1) {
        dense_.forward_one(front.columns, front.leading_rows(), d, front.leading_pivot(), l, front.leading_rows(),
                           inverse, x, t_.data());
      } else {
        dense_.divide_transposed(width_, front.columns, d, front.leading_pivot(), inverse, x, width_);
        std::fill_n(t_.begin(), front.rows * width_, 0.0);
        dense_.subtract_product(width_, front.rows, front.columns, x, width_, l, front.leading_rows(), 1, t_.data(),
                                width_);
      }
      const int32_t* row = s_.row_scalar.data() + front.row_start;
      for (int64_t i = 0; i < front.rows; ++i) {
        for (int64_t c = 0; c < width_; ++c) y[row[i] * width_ + c] += t_[i * width_ + c];
      }
    }
  }

  void backward(double* y, size_t fronts) {
    for (size_t f = fronts; f-- > 0;) {
      const Front& front = s_.front[f];
      const double* d = panel_ + front.panel;
      const double* l = d + front.below();
      double* x = y + front.first_scalar * width_;
      const double* inverse = inverse_ + front.first_scalar;
      const int32_t* row = s_.row_scalar.data() + front.row_start;
      for (int64_t i = 0; i < front.rows; ++i) {
        for (int64_t c = 0; c < width_; ++c) t_[i * width_ + c] = y[row[i] * width_ + c];
      }
      if (width_ == 1) {
        std::fill(t_.begin() + front.rows, t_.begin() + front.leading_rows(), 0.0);
        dense_.backward_one(front.columns, front.leading_rows(), d, front.leading_pivot(), l, front.leading_rows(),
                            inverse, x, t_.data());
      } else {
        dense_.subtract_product(width_, front.columns, front.rows, t_.data(), width_, l, 1, front.leading_rows(), x,
                                width_);
        dense_.divide(width_, front.columns, d, front.leading_pivot(), inverse, x, width_);
      }
    }
  }

 private:
  const Symbolic& s_;
  const double* panel_;
  const double* inverse_;
  int64_t width_;
  const DenseKernels& dense_;
  std::vector<double> t_;
};

// Calls body(sweep, y) on the columns of rhs, permuted, in groups of one or `wide`, and writes y back: to natural
// positions if `natural`, else in elimination order.
template <class Body>
void over_columns(const Symbolic& s, const double* panel, const double* inverse, double* rhs, int64_t columns,
                  bool natural, const Body& body) {
  const int64_t width = columns == 1 ? 1 : wide;
  Sweep sweep(s, panel, inverse, width);
  std::vector<double> y(static_cast<size_t>(s.scalars * width), 0.0);
  for (int64_t c0 = 0; c0 < columns; c0 += width) {
    const int64_t count = std::min(width, columns - c0);
    double* group = rhs + c0 * s.scalars;
    for (int64_t i = 0; i < s.scalars; ++i) {
      for (int64_t c = 0; c < count; ++c) y[i * width + c] = group[s.natural_scalar[i] + c * s.scalars];
      for (int64_t c = count; c < width; ++c) y[i * width + c] = 0;
    }
    body(sweep, y.data());
    for (int64_t i = 0; i < s.scalars; ++i) {
      const int64_t to = natural ? s.natural_scalar[i] : i;
      for (int64_t c = 0; c < count; ++c) group[to + c * s.scalars] = y[i * width + c];
    }
  }
}

}  // namespace

void Cholesky::solve(double* rhs, int64_t columns) const {
  const size_t fronts = symbolic_->front.size();
  over_columns(*symbolic_, numeric_->panel.get(), numeric_->inverse.data(), rhs, columns, true,
               [&](Sweep& sweep, double* y) {
                 sweep.forward(y, fronts);
                 sweep.backward(y, fronts);
               });
}

void Cholesky::solve_lower(double* rhs, int64_t columns) const {
  over_columns(*symbolic_, numeric_->panel.get(), numeric_->inverse.data(), rhs, columns, false,
               [&](Sweep& sweep, double* y) { sweep.forward(y, symbolic_->front.size()); });
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
  over_columns(s, numeric_->panel.get(), numeric_->inverse.data(), y.data(), 1, false,
               [&](Sweep& sweep, double* x) { sweep.forward(x, s.front.size() - 1); });
  std::copy(y.begin() + (s.scalars - m), y.end(), reduced_rhs);
  return failed;
}

void Cholesky::back_substitute(const double* last_solution, double* rhs_inout) const {
  const Symbolic& s = *symbolic_;
  const size_t interiors = s.front.size() - (s.last_scalars > 0 ? 1 : 0);
  over_columns(s, numeric_->panel.get(), numeric_->inverse.data(), rhs_inout, 1, true, [&](Sweep& sweep, double* y) {
    sweep.forward(y, interiors);
    std::copy(last_solution, last_solution + s.last_scalars, y + (s.scalars - s.last_scalars));
    sweep.backward(y, interiors);
  });
}

}  // namespace teamslam
