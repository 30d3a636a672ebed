// Refinement of vertex separators: see dissection.hpp.
//
// Moving a separator vertex to one side pulls its neighbours on the other side into the separator. The gain is the
// weight that the separator loses. A pass moves the best vertex to its side again and again, also when that makes
// matters worse, each vertex once, and then goes back to the best state that it saw. All moves of a pass go to the same
// side, so that the separator sweeps through the graph instead of quivering in place; passes alternate between sides.
#include <algorithm>
#include <cstdlib>
#include <queue>

#include "dissection.hpp"

namespace teamslam {
namespace {

struct Candidate {
  int64_t gain;
  int32_t vertex;
  bool operator<(const Candidate& other) const {
    return gain != other.gain ? gain < other.gain : vertex > other.vertex;
  }
};

class Pass {
 public:
  Pass(const WeightedGraph& graph, Separation& separation)
      : graph_(graph), s_(separation), moved_(graph.size(), 0), pull_(graph.size(), 0) {}

  // Returns whether the separation became better by moves to side `to`.
  bool run(uint8_t to) {
    to_ = to;
    other_ = static_cast<uint8_t>(1 - to);
    queue_ = {};
    log_.clear();
    std::fill(moved_.begin(), moved_.end(), 0);
    size_t border = 0;
    for (int32_t v = 0; v < graph_.size(); ++v) {
      if (s_.side[v] != separator) continue;
      enter(v);
      ++border;
    }
    const size_t patience = std::min<size_t>(5 * border, 3000);
    Separation best;
    std::copy(s_.weight, s_.weight + 3, best.weight);
    size_t best_length = 0;
    for (size_t worse = 0; worse < patience && choose(); ++worse) {
      move();
      if (!better(s_, best, graph_.total)) continue;
      std::copy(s_.weight, s_.weight + 3, best.weight);
      best_length = log_.size();
      worse = 0;
    }
    for (; log_.size() > best_length; log_.pop_back()) put(log_.back().vertex, log_.back().from);
    return best_length > 0;
  }

 private:
  struct Change {
    int32_t vertex;
    uint8_t from;
  };

  int64_t gain(int32_t v) const { return graph_.weight[v] - pull_[v]; }

  void put(int32_t v, uint8_t side) {
    s_.weight[s_.side[v]] -= graph_.weight[v];
    s_.weight[side] += graph_.weight[v];
    s_.side[v] = side;
  }

  // A vertex that has come into the separator: the weight that its move would pull in.
  void enter(int32_t v) {
    pull_[v] = 0;
    for (int32_t k = graph_.start[v]; k < graph_.start[v + 1]; ++k) {
      const int32_t u = graph_.neighbour[k];
      if (s_.side[u] == other_) pull_[v] += graph_.weight[u];
    }
    queue_.push({gain(v), v});
  }

  // Brings the best vertex that may move to the top of the queue; entries that are out of date are dropped.
  bool choose() {
    for (; !queue_.empty(); queue_.pop()) {
      const Candidate& c = queue_.top();
      if (moved_[c.vertex] || s_.side[c.vertex] != separator || gain(c.vertex) != c.gain) continue;
      const int64_t after = s_.weight[to_] + graph_.weight[c.vertex];
      if (after <= side_limit(graph_.total) || s_.weight[to_] < s_.weight[other_]) return true;
    }
    return false;
  }

  void move() {
    const int32_t v = queue_.top().vertex;
    queue_.pop();
    log_.push_back({v, separator});
    put(v, to_);
    moved_[v] = 1;
    for (int32_t k = graph_.start[v]; k < graph_.start[v + 1]; ++k) {
      const int32_t u = graph_.neighbour[k];
      if (s_.side[u] != other_) continue;
      log_.push_back({u, other_});
      put(u, separator);
      for (int32_t e = graph_.start[u]; e < graph_.start[u + 1]; ++e) {
        const int32_t w = graph_.neighbour[e];
        if (s_.side[w] != separator || moved_[w]) continue;
        pull_[w] -= graph_.weight[u];
        queue_.push({gain(w), w});
      }
      enter(u);
    }
  }

  const WeightedGraph& graph_;
  Separation& s_;
  std::vector<uint8_t> moved_;
  std::vector<int64_t> pull_;  // weight of a separator vertex's neighbours on the other side
  std::priority_queue<Candidate> queue_;
  std::vector<Change> log_;
  uint8_t to_ = left, other_ = right;
};

}  // namespace

bool better(const Separation& a, const Separation& b, int64_t total) {
  const int64_t limit = side_limit(total);
  const auto excess = [&](const Separation& s) {
    return std::max<int64_t>(0, std::max(s.weight[left], s.weight[right]) - limit);
  };
  if (excess(a) != excess(b)) return excess(a) < excess(b);
  const auto quotient = [](const Separation& s) {
    return static_cast<double>(s.weight[separator]) /
           (static_cast<double>(s.weight[left] + 1) * static_cast<double>(s.weight[right] + 1));
  };
  return quotient(a) < quotient(b);
}

void refine(const WeightedGraph& graph, Separation& separation, int passes) {
  Pass pass(graph, separation);
  uint8_t to = separation.weight[left] < separation.weight[right] ? left : right;
  int idle = 0;
  for (int k = 0; k < 2 * passes && idle < 2; ++k) {
    idle = pass.run(to) ? 0 : idle + 1;
    to = static_cast<uint8_t>(1 - to);
  }
}

}  // namespace teamslam
