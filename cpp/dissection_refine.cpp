// Refinement of vertex separators: see dissection.hpp.
//
// Moving a separator vertex to one side pulls its neighbours on the other side into the separator. The gain is the
// weight that the separator loses. A pass moves the best vertex again and again, also when that makes matters worse,
// each vertex once, and then goes back to the best state that it saw.
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
      : graph_(graph), s_(separation), moved_(graph.size(), 0), pull_{Weights(graph.size(), 0), Weights(graph.size(), 0)} {}

  // Returns whether the separation became better.
  bool run() {
    std::fill(moved_.begin(), moved_.end(), 0);
    log_.clear();
    for (auto& queue : queue_) queue = {};
    for (int32_t v = 0; v < graph_.size(); ++v) {
      if (s_.side[v] == separator) enter(v);
    }
    Separation best;
    std::copy(s_.weight, s_.weight + 3, best.weight);
    size_t best_length = 0;
    const size_t patience = std::clamp<size_t>(static_cast<size_t>(graph_.size()) / 50, 25, 150);
    size_t last_better = 0, moves = 0;
    while (moves - last_better < patience) {
      const int to = choose();
      if (to < 0) break;
      move(to);
      ++moves;
      if (better(s_, best, graph_.total)) {
        std::copy(s_.weight, s_.weight + 3, best.weight);
        best_length = log_.size();
        last_better = moves;
      }
    }
    const bool improved = best_length > 0;
    while (log_.size() > best_length) {
      const Change change = log_.back();
      log_.pop_back();
      put(change.vertex, change.from);
    }
    return improved;
  }

 private:
  using Weights = std::vector<int64_t>;
  struct Change {
    int32_t vertex;
    uint8_t from;
  };

  int64_t gain(int32_t v, int to) const { return graph_.weight[v] - pull_[to][v]; }

  void put(int32_t v, uint8_t side) {
    s_.weight[s_.side[v]] -= graph_.weight[v];
    s_.weight[side] += graph_.weight[v];
    s_.side[v] = side;
  }

  void offer(int32_t v, int to) {
    if (!moved_[v]) queue_[to].push({gain(v, to), v});
  }

  // A vertex that has come into the separator: what it would pull in with a move to either side.
  void enter(int32_t v) {
    pull_[left][v] = pull_[right][v] = 0;
    for (int32_t k = graph_.start[v]; k < graph_.start[v + 1]; ++k) {
      const int32_t u = graph_.neighbour[k];
      if (s_.side[u] != separator) pull_[1 - s_.side[u]][v] += graph_.weight[u];
    }
    offer(v, left);
    offer(v, right);
  }

  // The side that the next vertex should move to, with that vertex on top of its queue; -1 if none is left.
  int choose() {
    int64_t gains[2];
    bool open[2];
    for (int to = 0; to < 2; ++to) {
      auto& queue = queue_[to];
      while (!queue.empty()) {
        const Candidate c = queue.top();
        if (s_.side[c.vertex] == separator && !moved_[c.vertex] && gain(c.vertex, to) == c.gain) break;
        queue.pop();
      }
      open[to] = !queue.empty();
      if (open[to]) {
        gains[to] = queue.top().gain;
        const int64_t after = s_.weight[to] + graph_.weight[queue.top().vertex];
        if (after > side_limit(graph_.total) && s_.weight[to] >= s_.weight[1 - to]) open[to] = false;
      }
    }
    if (!open[0] || !open[1]) return open[0] ? 0 : open[1] ? 1 : -1;
    if (gains[0] != gains[1]) return gains[0] > gains[1] ? 0 : 1;
    return s_.weight[left] <= s_.weight[right] ? 0 : 1;
  }

  void move(int to) {
    const int32_t v = queue_[to].top().vertex;
    queue_[to].pop();
    const int other = 1 - to;
    log_.push_back({v, separator});
    put(v, static_cast<uint8_t>(to));
    moved_[v] = 1;
    for (int32_t k = graph_.start[v]; k < graph_.start[v + 1]; ++k) {
      const int32_t u = graph_.neighbour[k];
      if (s_.side[u] == separator) {
        pull_[other][u] += graph_.weight[v];
        offer(u, other);
      } else if (s_.side[u] == other) {
        log_.push_back({u, static_cast<uint8_t>(other)});
        put(u, separator);
        for (int32_t e = graph_.start[u]; e < graph_.start[u + 1]; ++e) {
          const int32_t w = graph_.neighbour[e];
          if (s_.side[w] != separator || w == u) continue;
          pull_[to][w] -= graph_.weight[u];
          offer(w, to);
        }
        enter(u);
      }
    }
  }

  const WeightedGraph& graph_;
  Separation& s_;
  std::vector<uint8_t> moved_;
  Weights pull_[2];
  std::priority_queue<Candidate> queue_[2];
  std::vector<Change> log_;
};

}  // namespace

bool better(const Separation& a, const Separation& b, int64_t total) {
  const int64_t limit = side_limit(total);
  const auto excess = [&](const Separation& s) {
    return std::max<int64_t>(0, std::max(s.weight[left], s.weight[right]) - limit);
  };
  if (excess(a) != excess(b)) return excess(a) < excess(b);
  if (a.weight[separator] != b.weight[separator]) return a.weight[separator] < b.weight[separator];
  return std::abs(a.weight[left] - a.weight[right]) < std::abs(b.weight[left] - b.weight[right]);
}

void refine(const WeightedGraph& graph, Separation& separation, int passes) {
  Pass pass(graph, separation);
  for (int k = 0; k < passes && pass.run(); ++k) {
  }
}

}  // namespace teamslam
