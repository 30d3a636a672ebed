// The numeric phase, front by front: assemble the pattern's blocks and the children's update matrices, factor the
// pivots, and leave the update matrix for the parent.
//
// A front is done by one thread, or by the team when it stands above all tasks. Both do the same arithmetic in the same
// order for every entry of the factor, so the bits agree.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "cholesky_numeric.hpp"

namespace teamslam {
namespace {

constexpr int64_t block = 64;  // pivots factored at a time
constexpr double pivot_tolerance = 64 * std::numeric_limits<double>::epsilon();

// This member's share of begin .. end, in multiples of 4.
struct Share {
  int64_t begin, end;
  Share(const Team& team, int64_t first, int64_t last) {
    const int64_t step = padded((last - first + team.size() - 1) / team.size());
    begin = std::min(last, first + step * team.index());
    end = std::min(last, begin + step);
  }
  int64_t size() const { return end - begin; }
};

// The columns of a lower triangle of `size` that make up this member's share of its area.
Share triangle_share(const Team& team, int64_t size) {
  Share share(team, 0, size);
  const auto cut = [&](int part) {
    if (part == team.size()) return size;
    const double rest = 1 - static_cast<double>(part) / team.size();
    return std::min(size, padded(static_cast<int64_t>(static_cast<double>(size) * (1 - std::sqrt(rest)))));
  };
  share.begin = cut(team.index());
  share.end = cut(team.index() + 1);
  return share;
}

}  // namespace

Factorisation::Factorisation(const Input& input, double* panel, double* inverse, double* lowest, double* handoff,
                             double* workspace)
    : input_(input), dense_(dense_kernels()), panel_(panel), inverse_(inverse), lowest_(lowest) {
  const auto& size = input.symbolic.stack_size;
  stack_[0] = workspace;
  stack_[1] = workspace + size[0];
  stack_[2] = handoff;
  stack_[3] = handoff + size[2];
  stack_[4] = handoff + size[2] + size[3];
}

double* Factorisation::update_of(const Front& front) const { return stack_[front.stack] + front.update; }

Destination Factorisation::destination(const Front& front) const {
  double* d = panel_ + front.panel;
  return {front.columns, d, front.leading_pivot(), d + front.below(), update_of(front), front.leading_rows()};
}

void Factorisation::scatter(const Front& front) const {
  const Symbolic& s = input_.symbolic;
  double* panel = panel_ + front.panel;
  for (int64_t e = front.scatter_start; e < front.scatter_end; ++e) {
    const Scatter& block = s.scatter[e];
    const double* from = input_.values + block.value;
    double* to = panel + block.target;
    const bool transposed = block.leading < 0;
    const int64_t down = transposed ? -static_cast<int64_t>(block.leading) : 1;
    const int64_t across = transposed ? 1 : block.leading;
    for (int32_t j = 0; j < block.columns; ++j) {
      for (int32_t i = 0; i < block.rows; ++i) to[i * down + j * across] = *from++;
    }
  }
  for (int64_t j = 0; j < front.columns; ++j) {
    double& diagonal = panel[j * (front.leading_pivot() + 1)];
    if (input_.damping != nullptr) diagonal += input_.damping[s.natural_scalar[front.first_scalar + j]];
    lowest_[front.first_scalar + j] = pivot_tolerance * std::abs(diagonal);
  }
}

void Factorisation::add_children(const Front& front, int64_t begin, int64_t end) const {
  const Symbolic& s = input_.symbolic;
  const Destination to = destination(front);
  for (int64_t c = front.child_start; c < front.child_end; ++c) {
    const Front& child = s.front[s.child[c]];
    dense_.extend_add(update_of(child), child.leading_rows(), s.run.data() + child.run_start,
                      child.run_end - child.run_start, to, begin, end);
  }
}

bool Factorisation::factor_alone(int32_t f) {
  Team alone;
  std::atomic<bool> failed{false};
  return factor_together(f, alone, failed);
}

bool Factorisation::factor_together(int32_t f, Team& team, std::atomic<bool>& failed) {
  const Front& front = input_.symbolic.front[f];
  const Destination to = destination(front);
  const int64_t columns = front.columns, rows = front.leading_rows();
  const int64_t d_leading = to.pivot_leading;
  const bool factors = !(input_.keep_last && f + 1 == static_cast<int32_t>(input_.symbolic.front.size()));

  if (team.index() == 0) {
    std::memset(to.pivots, 0, sizeof(double) * static_cast<size_t>(front.panel_size()));
    scatter(front);
  }
  const Share zeroed = triangle_share(team, rows);
  for (int64_t j = zeroed.begin; j < zeroed.end; ++j) {
    const int64_t from = j & ~int64_t{3};
    std::memset(to.update + from + j * rows, 0, sizeof(double) * static_cast<size_t>(rows - from));
  }
  team.barrier();
  const Share assembled = triangle_share(team, padded(columns + front.rows));
  add_children(front, assembled.begin, assembled.end);
  team.barrier();
  if (!factors) return true;

  double* inverse = inverse_ + front.first_scalar;
  for (int64_t j = 0; j < columns; j += block) {
    const int64_t width = std::min(block, columns - j);
    double* at = to.pivots + j * d_leading;  // column j, row 0
    if (j > 0) {
      const Share share(team, j, d_leading);
      dense_.subtract_product(share.size(), width, j, to.pivots + share.begin, d_leading, to.pivots + j, d_leading, 1,
                              at + share.begin, d_leading);
      team.barrier();
    }
    if (team.index() == 0) {
      const int64_t stopped =
          dense_.factor(width, at + j, d_leading, lowest_ + front.first_scalar + j, inverse + j);
      if (stopped >= 0) {
        failed_scalar_ = front.first_scalar + j + stopped;
        failed.store(true, std::memory_order_release);
      }
    }
    team.barrier();
    if (failed.load(std::memory_order_acquire)) return false;
    if (j + width < columns) {
      const Share share(team, j + width, d_leading);
      dense_.divide_transposed(share.size(), width, at + j, d_leading, inverse + j, at + share.begin, d_leading);
      team.barrier();
    }
  }
  if (rows > 0) {
    const Share share(team, 0, rows);
    dense_.divide_transposed(share.size(), columns, to.pivots, d_leading, inverse, to.rows + share.begin, rows);
    team.barrier();
    const Share square = triangle_share(team, rows);
    dense_.subtract_square(rows, columns, to.rows, rows, to.update, rows, square.begin, square.end);
  }
  team.barrier();
  return true;
}

}  // namespace teamslam
