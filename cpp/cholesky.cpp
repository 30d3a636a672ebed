// Analysis and factorisation: see cholesky.hpp. Solves are in cholesky_solve.cpp, inverses in selected_inverse.cpp.
#include "cholesky.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "cholesky_numeric.hpp"

namespace teamslam {
namespace {

struct Choice {
  Elimination elimination;
  Ordering used;
};

// The variables free to move in the order of `method`, then `last`.
Elimination ordered(const Graph& graph, Ordering method, const std::vector<uint8_t>& frozen, const double* positions,
                    const int32_t* last, int32_t last_count, int threads) {
  std::vector<int32_t> order;
  if (method == Ordering::natural) {
    for (int32_t v = 0; v < graph.size(); ++v) {
      if (frozen.empty() || !frozen[v]) order.push_back(v);
    }
  } else if (method == Ordering::minimum_degree) {
    order = minimum_degree(graph, frozen);
  } else {
    order = nested_dissection(graph, frozen, method == Ordering::geometric ? positions : nullptr, threads);
  }
  order.insert(order.end(), last, last + last_count);
  return eliminate_symbolically(graph, order, last_count);
}

// Minimum degree is cheap and best for small problems. Large ones are dissected at once: where minimum degree would do
// better still, as on one long road with a few landmarks, there is little to gain.
Choice chosen(const Graph& graph, Ordering asked, const std::vector<uint8_t>& frozen, const double* positions,
              const int32_t* last, int32_t last_count, int threads) {
  Ordering used = asked;
  if (asked == Ordering::automatic) {
    const bool small = graph.size() - last_count < dissected_from;
    used = small                  ? Ordering::minimum_degree
           : positions != nullptr ? Ordering::geometric
                                  : Ordering::nested_dissection;
  }
  return {ordered(graph, used, frozen, positions, last, last_count, threads), used};
}

}  // namespace

Analysis analysed(const BlockPattern& pattern, Ordering ordering, const double* positions, const int32_t* last,
                  int32_t last_count, int threads) {
  const Graph graph = graph_of(pattern);
  std::vector<uint8_t> frozen;
  if (last_count > 0) {
    frozen.assign(static_cast<size_t>(pattern.variables()), 0);
    for (int32_t k = 0; k < last_count; ++k) frozen[last[k]] = never_eliminated;
  }
  const Choice choice = chosen(graph, ordering, frozen, positions, last, last_count, threads);
  auto symbolic = std::make_shared<Symbolic>(analyse(pattern, graph, choice.elimination, last_count));
  symbolic->used = choice.used;
  return symbolic;
}

Cholesky::Cholesky(Analysis analysis, int threads)
    : symbolic_(std::move(analysis)), numeric_(std::make_unique<Numeric>()), threads_(std::max(threads, 1)) {}

Cholesky::~Cholesky() = default;
Cholesky::Cholesky(Cholesky&&) noexcept = default;
Cholesky& Cholesky::operator=(Cholesky&&) noexcept = default;

int32_t Cholesky::run(const double* values, const double* damping, bool keep_last) {
  const Symbolic& s = *symbolic_;
  numeric_->prepare(s, s.task.size() > 1 ? threads_ : 1);
  const Factorisation::Input input{s, values, damping, keep_last};
  std::vector<int32_t> queue(s.task.size());  // largest tasks first
  std::iota(queue.begin(), queue.end(), 0);
  std::stable_sort(queue.begin(), queue.end(),
                   [&](int32_t a, int32_t b) { return s.task[a].work > s.task[b].work; });
  std::atomic<size_t> next{0};
  std::atomic<int64_t> first_failure{s.scalars};
  std::atomic<bool> failed{false};
  const auto report = [&](int64_t scalar) {
    int64_t seen = first_failure.load();
    while (scalar < seen && !first_failure.compare_exchange_weak(seen, scalar)) {
    }
  };
  run_team(static_cast<int>(numeric_->workspace.size()), [&](Team& team) {
    Numeric& numeric = *numeric_;
    Factorisation work(input, numeric.panel.get(), numeric.inverse.data(), numeric.lowest.data(),
                       numeric.handoff.get(), numeric.workspace[static_cast<size_t>(team.index())].get());
    const auto factor_subtree = [&](const Task& task) {
      for (int32_t f = task.first; f < task.end; ++f) {
        if (work.factor_alone(f)) continue;
        report(work.failed_scalar());
        return;
      }
    };
    for (size_t k = next++; k < queue.size(); k = next++) factor_subtree(s.task[queue[k]]);
    // Above the tasks, a barrier stands wherever one member's work meets what others may still be doing. A pivot that
    // fails there stops nobody, so that all members keep to the same barriers.
    team.gather();
    enum { settled, others_at_work, first_at_work } state = others_at_work;
    const auto settle = [&] {
      if (state != settled) team.barrier();
      state = settled;
    };
    for (const Step& step : s.top) {
      if (step.late_start < step.late_end) {
        settle();
        for (int32_t k = step.late_start + team.index(); k < step.late_end; k += team.size()) factor_subtree(s.late[k]);
        state = others_at_work;
      }
      if (step.shared || state == others_at_work) settle();
      if (step.shared) {
        if (work.factor_together(step.front, team, failed)) continue;
        if (team.index() == 0) report(work.failed_scalar());
        return;
      }
      if (team.index() == 0 && !work.factor_alone(step.front)) report(work.failed_scalar());
      state = first_at_work;
    }
  });
  const int64_t scalar = first_failure.load();
  if (scalar == s.scalars) return -1;
  return static_cast<int32_t>(std::upper_bound(s.scalar_start.begin(), s.scalar_start.end(), s.natural_scalar[scalar]) -
                              s.scalar_start.begin()) - 1;
}

int32_t Cholesky::factor(const double* values, const double* damping) { return run(values, damping, false); }

void Cholesky::Numeric::prepare(const Symbolic& s, int threads) {
  if (handoff == nullptr) handoff = buffer(s.stack_size[2] + s.stack_size[3] + s.stack_size[4]);
  if (panel == nullptr) {
    panel = buffer(s.panel_total);
    inverse.resize(static_cast<size_t>(s.scalars));
    lowest.resize(static_cast<size_t>(s.scalars));
  }
  while (static_cast<int>(workspace.size()) < threads) workspace.push_back(buffer(s.stack_size[0] + s.stack_size[1]));
}

void Cholesky::put_away() {
  numeric_->handoff.reset();
  numeric_->workspace.clear();
}

double Cholesky::log_determinant() const {
  double sum = 0;
  for (double x : numeric_->inverse) sum -= std::log(x);
  return 2 * sum;
}

const int32_t* Cholesky::order() const { return symbolic_->order.data(); }
int64_t Cholesky::last_scalars() const { return symbolic_->last_scalars; }
int64_t Cholesky::factor_nonzeros() const { return static_cast<int64_t>(symbolic_->nonzeros); }
double Cholesky::flops() const { return symbolic_->flops; }
Ordering Cholesky::used() const { return symbolic_->used; }

size_t Cholesky::bytes() const {
  const Symbolic& s = *symbolic_;
  const int64_t doubles = s.panel_total + s.stack_size[2] + s.stack_size[3] + s.stack_size[4] + 2 * s.scalars +
                          static_cast<int64_t>(numeric_->workspace.size()) * (s.stack_size[0] + s.stack_size[1]);
  return s.bytes() + sizeof(double) * static_cast<size_t>(doubles);
}

}  // namespace teamslam
