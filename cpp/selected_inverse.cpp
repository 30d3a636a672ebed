// Entries of the inverse on the pattern (Takahashi, Fagan and Chin 1973), front by front from the roots.
//
// With L of a front split into its pivot block D and the rows below it B, and Y = B D^-1, the inverse obeys
//   Z_below,pivots = -Z_below,below Y   and   Z_pivots = D^-T D^-1 - Y' Z_below,pivots,
// where Z_below,below is a submatrix of the parent's front of the inverse, already known. So a front needs its ancestors
// and nothing else: fronts below which nothing is wanted are left out, and subtrees are shared out among the team.
#include <algorithm>
#include <atomic>
#include <cstring>
#include <mutex>
#include <thread>

#include "cholesky_numeric.hpp"

namespace teamslam {
namespace {

// A front of the inverse, symmetric and whole: pivots, rows by pivots, rows by rows.
struct InverseFront {
  Buffer memory;
  double* pivots = nullptr;  // leading padded(columns)
  double* rows = nullptr;    // leading padded(rows)
  double* below = nullptr;   // leading padded(rows), padded(rows) columns
  std::atomic<int64_t> children_left = 0;
};

// Fronts and subtrees that may be done now, for the team to take from; each makes others ready.
class Ready {
 public:
  void add(int32_t front) {
    const std::lock_guard<std::mutex> lock(mutex_);
    waiting_.push_back(front);
    ++unfinished_;
  }

  // The next one, or -1 when all is done.
  int32_t take() {
    while (unfinished_ > 0 && !abandoned_) {
      {
        const std::lock_guard<std::mutex> lock(mutex_);
        if (!waiting_.empty()) {
          const int32_t front = waiting_.back();
          waiting_.pop_back();
          return front;
        }
      }
      std::this_thread::yield();
    }
    return -1;
  }

  // After everything that it makes ready has been added.
  void finish() { --unfinished_; }
  // What a member that fails tells the others.
  void abandon() { abandoned_ = true; }

 private:
  std::mutex mutex_;
  std::vector<int32_t> waiting_;
  std::atomic<int64_t> unfinished_{0};
  std::atomic<bool> abandoned_{false};
};

// The inverse of wanted fronts: what all members of a team share.
class Inversion {
 public:
  // wanted: by front; everything if empty.
  Inversion(const Symbolic& s, const double* panel, const double* inverse, std::vector<uint8_t> wanted)
      : s_(s), panel_(panel), inverse_(inverse), dense_(dense_kernels()), front_(s.front.size()),
        needed_(std::move(wanted)), subtree_(s.front.size(), above) {
    if (needed_.empty()) needed_.assign(s.front.size(), 1);
    for (size_t f = 0; f < s.front.size(); ++f) {
      const int32_t parent = s.front[f].parent;
      if (!needed_[f] || parent < 0) continue;
      needed_[parent] = 1;
      ++front_[parent].children_left;
    }
    for (const auto* tasks : {&s.task, &s.late}) {
      for (const Task& task : *tasks) subtree_[task.end - 1] = task.first;
    }
  }

  // Calls use(front, panel of the inverse) for every needed front: the panel is laid out as the factor's.
  template <class Use>
  void run(int threads, const Use& use) {
    Ready ready;
    for (const auto* tasks : {&s_.task, &s_.late}) {
      for (const Task& task : *tasks) start(ready, task.end - 1);
    }
    for (const Step& step : s_.top) start(ready, step.front);
    run_team(s_.task.size() > 1 ? threads : 1, [&](Team&) {
      Scratch scratch;
      try {
        for (int32_t f = ready.take(); f >= 0; f = ready.take()) {
          invert_down_to(subtree_[f] == above ? f : subtree_[f], f, scratch, use);
          if (subtree_[f] == above) add_children(ready, f);
          ready.finish();
        }
      } catch (...) {
        ready.abandon();
        throw;
      }
    });
  }

 private:
  static constexpr int32_t above = -1;  // a front above all subtrees

  struct Scratch {
    std::vector<double> y, turned;
  };

  // What hangs on no parent is ready from the beginning. (A subtree may be a forest.)
  void start(Ready& ready, int32_t f) const {
    if (s_.front[f].parent < 0) ready.add(f);
  }

  void add_children(Ready& ready, int32_t f) const {
    const Front& front = s_.front[f];
    for (int64_t c = front.child_start; c < front.child_end; ++c) {
      if (needed_[s_.child[c]]) ready.add(s_.child[c]);
    }
  }

  template <class Use>
  void invert_down_to(int32_t first, int32_t f, Scratch& scratch, const Use& use) {
    for (int32_t g = f; g >= first; --g) {
      if (!needed_[g]) continue;
      invert(g, scratch);
      use(s_.front[g], front_[g].pivots);
      release(g);
    }
  }

  void release(int32_t f) {
    if (front_[f].children_left == 0) front_[f].memory.reset();
    const int32_t parent = s_.front[f].parent;
    if (parent >= 0 && --front_[parent].children_left == 0) front_[parent].memory.reset();
  }

  // Z_below,below from the parent's front.
  void gather(const Front& front, double* z) const {
    const Front& parent = s_.front[front.parent];
    const InverseFront& from = front_[front.parent];
    const int64_t leading = front.leading_rows(), up = parent.leading_rows(), k = parent.columns;
    std::memset(z, 0, sizeof(double) * static_cast<size_t>(front.update_size()));
    const Run* run = s_.run.data() + front.run_start;
    const int64_t runs = front.run_end - front.run_start;
    for (int64_t r = 0; r < runs; ++r) {
      for (int64_t j = 0; j < run[r].length; ++j) {
        const int64_t column = run[r].to + j, own = run[r].from + j;
        for (int64_t q = r; q < runs; ++q) {
          const double* source = nullptr;
          if (column >= k) {
            source = from.below + (column - k) * up + (run[q].to - k);
          } else if (run[q].to >= k) {
            source = from.rows + column * up + (run[q].to - k);
          } else {
            source = from.pivots + column * parent.leading_pivot() + run[q].to;
          }
          for (int64_t i = 0; i < run[q].length; ++i) z[run[q].from + i + own * leading] = source[i];
        }
      }
    }
    constexpr int64_t square = 16;  // mirrored square by square, so that lines stay in cache
    for (int64_t j0 = 0; j0 < front.rows; j0 += square) {
      const int64_t j1 = std::min<int64_t>(front.rows, j0 + square);
      for (int64_t i0 = j0; i0 < front.rows; i0 += square) {
        const int64_t i1 = std::min<int64_t>(front.rows, i0 + square);
        for (int64_t j = j0; j < j1; ++j) {
          for (int64_t i = std::max(i0, j + 1); i < i1; ++i) z[j + i * leading] = z[i + j * leading];
        }
      }
    }
  }

  // z = D^-T D^-1: the identity divided by D' and by D. D^-T is upper triangular and the result symmetric, so that rows
  // r .. of the upper triangle need only the part of D from r on.
  void invert_pivots(int64_t k, const double* d, int64_t leading, const double* reciprocal, double* z) const {
    constexpr int64_t strip = 64;
    for (int64_t j = 0; j < k; ++j) z[j * (leading + 1)] = 1;
    for (int64_t r = 0; r < k; r += strip) {
      const int64_t at = r * (leading + 1), rows = std::min(strip, leading - r);
      dense_.divide_transposed(rows, k - r, d + at, leading, reciprocal + r, z + at, leading);
      dense_.divide(rows, k - r, d + at, leading, reciprocal + r, z + at, leading);
      for (int64_t j = r + strip; j < k; ++j) {
        for (int64_t i = r; i < r + strip; ++i) z[j + i * leading] = z[i + j * leading];
      }
    }
  }

  void invert(int32_t f, Scratch& scratch) {
    const Front& front = s_.front[f];
    InverseFront& z = front_[f];
    const int64_t k = front.columns, kp = front.leading_pivot(), m = front.rows, mp = front.leading_rows();
    z.memory = buffer(front.panel_size() + front.update_size());
    z.pivots = z.memory.get();
    z.rows = z.pivots + front.below();
    z.below = z.pivots + front.panel_size();
    const double* d = panel_ + front.panel;
    const double* reciprocal = inverse_ + front.first_scalar;
    std::memset(z.pivots, 0, sizeof(double) * static_cast<size_t>(front.panel_size()));
    invert_pivots(k, d, kp, reciprocal, z.pivots);
    if (m == 0) return;
    gather(front, z.below);
    auto& [y, turned] = scratch;
    y.assign(d + front.below(), d + front.panel_size());
    dense_.divide(mp, k, d, kp, reciprocal, y.data(), mp);
    dense_.subtract_product(mp, k, m, z.below, mp, y.data(), 1, mp, z.rows, mp);
    turned.assign(static_cast<size_t>(kp * mp), 0.0);
    for (int64_t j = 0; j < k; ++j) {
      for (int64_t i = 0; i < m; ++i) turned[j + i * kp] = y[i + j * mp];
    }
    dense_.subtract_product(kp, k, m, turned.data(), kp, z.rows, 1, mp, z.pivots, kp);
  }

  const Symbolic& s_;
  const double* panel_;
  const double* inverse_;
  const DenseKernels& dense_;
  std::vector<InverseFront> front_;
  std::vector<uint8_t> needed_;
  std::vector<int32_t> subtree_;  // by its last front: the first
};

// One pattern block out of a panel of the inverse.
void copy_block(const Scatter& block, const double* panel, double* to) {
  const double* from = panel + block.target;
  const bool transposed = block.leading < 0;
  const int64_t down = transposed ? -static_cast<int64_t>(block.leading) : 1;
  const int64_t across = transposed ? 1 : block.leading;
  for (int32_t j = 0; j < block.columns; ++j) {
    for (int32_t i = 0; i < block.rows; ++i) *to++ = from[i * down + j * across];
  }
}

}  // namespace

void Cholesky::inverse_on_pattern(double* values_out) const {
  const Symbolic& s = *symbolic_;
  Inversion inversion(s, numeric_->panel.get(), numeric_->inverse.data(), {});
  inversion.run(threads_, [&](const Front& front, const double* panel) {
    for (int64_t e = front.scatter_start; e < front.scatter_end; ++e) {
      copy_block(s.scatter[e], panel, values_out + s.scatter[e].value);
    }
  });
}

void Cholesky::diagonal_inverse(const int32_t* variables, int64_t count, double* blocks_out) const {
  const Symbolic& s = *symbolic_;
  std::vector<uint8_t> wanted(s.front.size(), 0);
  std::vector<std::vector<int64_t>> places(s.dof.size());  // of a variable's block in the result
  int64_t size = 0;
  for (int64_t i = 0; i < count; ++i) {
    places[variables[i]].push_back(size);
    size += int64_t{s.dof[variables[i]]} * s.dof[variables[i]];
  }
  for (size_t f = 0; f < s.front.size(); ++f) {
    const Front& front = s.front[f];
    for (int32_t p = front.first_position; p < front.first_position + front.variables; ++p) {
      if (!places[s.order[p]].empty()) wanted[f] = 1;
    }
  }
  Inversion inversion(s, numeric_->panel.get(), numeric_->inverse.data(), std::move(wanted));
  inversion.run(threads_, [&](const Front& front, const double* panel) {
    int64_t at = 0;
    for (int32_t p = front.first_position; p < front.first_position + front.variables; ++p) {
      const int32_t v = s.order[p], dof = s.dof[v];
      const auto target = static_cast<int32_t>(at * (front.leading_pivot() + 1));
      for (int64_t place : places[v]) {
        copy_block({0, target, static_cast<int32_t>(front.leading_pivot()), dof, dof}, panel, blocks_out + place);
      }
      at += dof;
    }
  });
}

}  // namespace teamslam
