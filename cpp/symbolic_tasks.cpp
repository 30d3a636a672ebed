// Which thread does what, and where update matrices live: see symbolic_steps.hpp.
#include <algorithm>

#include "symbolic_steps.hpp"

namespace teamslam {
namespace {

constexpr int32_t none = -1;

// Cuts the tree into subtrees small enough to share out; the same cut for any number of threads.
void cut_tasks(Symbolic& s) {
  const auto count = static_cast<int32_t>(s.front.size());
  std::vector<double> work(count, 0);
  std::vector<int32_t> first(count);
  double total = 0;
  for (int32_t f = 0; f < count; ++f) first[f] = f;
  for (int32_t f = 0; f < count; ++f) {
    const Front& front = s.front[f];
    const double own = front_time(front.columns, front.columns + front.rows);
    work[f] += own;
    total += own;
    if (front.parent != none) {
      work[front.parent] += work[f];
      first[front.parent] = std::min(first[front.parent], first[f]);
    }
  }
  // ns: below these a second thread costs more than it gives, for the whole tree and for one front
  const double worth_sharing = 3e6, worth_a_team = 2e5;
  const double grain = std::max(total / 24, 5e4);
  if (total < worth_sharing) {
    if (count > 0) s.task.push_back({0, count, total});
    return;
  }
  // Where a long chain of fronts carries many small branches, the results of all branches together would take more
  // memory than the factor. Such branches wait until their parent's turn.
  const double crumb = grain / 8;
  std::vector<std::vector<Task>> late(s.front.size());
  for (int32_t f = 0; f < count; ++f) {
    const int32_t parent = s.front[f].parent;
    const Task task{first[f], f + 1, work[f]};
    if (work[f] > grain) {
      const auto start = static_cast<int32_t>(s.late.size());
      s.late.insert(s.late.end(), late[f].begin(), late[f].end());
      const double own = front_time(s.front[f].columns, s.front[f].columns + s.front[f].rows);
      s.top.push_back({f, start, static_cast<int32_t>(s.late.size()), own > worth_a_team});
    } else if (parent == none || (work[parent] > grain && work[f] > crumb)) {
      s.task.push_back(task);
    } else if (work[parent] > grain) {
      late[parent].push_back(task);
    }
  }
}

// Update matrices on their stacks, by playing the numeric phase through.
void lay_out_stacks(Symbolic& s) {
  int64_t height[5] = {0, 0, 0, 0, 0};
  const auto place = [&](int32_t f, int32_t stack) {
    Front& front = s.front[f];
    for (int64_t c = front.child_start; c < front.child_end; ++c) {
      const Front& child = s.front[s.child[c]];
      if (child.stack != 2) height[child.stack] -= child.update_size();
    }
    front.stack = stack;
    front.update = height[stack];
    height[stack] += front.update_size();
    s.stack_size[stack] = std::max(s.stack_size[stack], height[stack]);
  };
  const auto place_task = [&](const Task& task, int32_t result) {
    for (int32_t f = task.first; f < task.end; ++f) place(f, f == task.end - 1 ? result : s.front[f].depth & 1);
  };
  for (const Task& task : s.task) place_task(task, 2);
  for (const Step& step : s.top) {
    const int32_t stack = 3 + (s.front[step.front].depth & 1);
    for (int32_t k = step.late_start; k < step.late_end; ++k) place_task(s.late[k], 7 - stack);
    place(step.front, stack);
  }
}

}  // namespace

void lay_out_tasks(Symbolic& symbolic) {
  cut_tasks(symbolic);
  lay_out_stacks(symbolic);
}

}  // namespace teamslam
