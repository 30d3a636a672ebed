// Approximate minimum degree ordering (Amestoy, Davis and Duff 1996, "An approximate minimum degree ordering
// algorithm"), on a weighted graph and in stages.
//
// The quotient graph holds variables, not yet eliminated, and elements, the cliques that elimination left. A variable
// lists its elements first and then its remaining variable neighbours; an element lists its variables. Eliminating a
// pivot merges its elements and neighbours into one new element. Indistinguishable variables are merged into one
// (hash, then compare), variables whose only neighbour is the new element are eliminated with the pivot, and degrees
// are bounded from above by sums over elements, which costs far less than counting.
//
// Vertices with very many neighbours (a submap's base, a landmark that everyone sees) would make every degree
// computation long and gain nothing: they are set aside and come last.
#include <algorithm>
#include <bit>
#include <cmath>

#include "ordering.hpp"

namespace teamslam {
namespace {

constexpr int32_t none = -1;

class MinimumDegree {
 public:
  MinimumDegree(const Graph& graph, const std::vector<uint8_t>& stage)
      : n_(graph.size()), stage_(stage), weight_(graph.weight), list_(n_), length_(n_), elements_(n_, 0),
        degree_(n_, 0), mark_(n_, 1), next_(n_, none), previous_(n_, none), tail_(n_), follower_(n_, none),
        dead_(n_, 0) {
    load(graph);
  }

  std::vector<int32_t> order() {
    std::vector<int32_t> pivots;
    while (advance()) {
      while (free_ > 0) {
        const int32_t pivot = lowest();
        pivots.push_back(pivot);
        eliminate(pivot);
      }
    }
    std::vector<int32_t> result;
    result.reserve(static_cast<size_t>(n_));
    for (int32_t pivot : pivots) {
      for (int32_t v = pivot; v != none; v = follower_[v]) result.push_back(v);
    }
    std::stable_sort(dense_.begin(), dense_.end(),
                     [this](int32_t a, int32_t b) { return degree_[a] < degree_[b]; });
    result.insert(result.end(), dense_.begin(), dense_.end());
    return result;
  }

 private:
  int stage(int32_t v) const { return stage_.empty() ? 0 : stage_[v]; }
  bool frozen(int32_t v) const { return stage(v) != now_; }

  // Frees the vertices of the next stage; false if there is none.
  bool advance() {
    int next = never_eliminated;
    for (int32_t v = 0; v < n_; ++v) {
      if (weight_[v] > 0 && stage(v) > now_) next = std::min(next, stage(v));
    }
    if (next == never_eliminated) return false;
    now_ = next;
    for (int32_t v = 0; v < n_; ++v) {
      if (weight_[v] <= 0 || stage(v) != now_) continue;
      free_ += weight_[v];
      insert(v);
    }
    return true;
  }

  void load(const Graph& graph) {
    const int64_t dense = dense_degree(n_);
    int64_t total = 0;
    for (int32_t v = 0; v < n_; ++v) {
      tail_[v] = v;
      total += weight_[v];
      if (graph.start[v + 1] - graph.start[v] > dense && stage(v) != never_eliminated) {
        dead_[v] = 1;
        degree_[v] = static_cast<int32_t>(graph.start[v + 1] - graph.start[v]);
        dense_.push_back(v);
      }
    }
    buckets_.assign(static_cast<size_t>(total) + 1, none);
    hash_head_.assign(std::bit_ceil(static_cast<size_t>(n_) + 1), none);
    hash_.assign(static_cast<size_t>(n_), 0);
    lists_.reserve(graph.neighbour.size() + graph.neighbour.size() / 4 + static_cast<size_t>(n_) + 16);
    lowest_ = static_cast<int32_t>(total);
    for (int32_t v = 0; v < n_; ++v) {
      list_[v] = static_cast<int64_t>(lists_.size());
      length_[v] = 0;
      if (dead_[v]) continue;
      int64_t degree = 0;
      for (int64_t k = graph.start[v]; k < graph.start[v + 1]; ++k) {
        const int32_t u = graph.neighbour[k];
        if (dead_[u]) continue;
        lists_.push_back(u);
        degree += weight_[u];
      }
      length_[v] = static_cast<int32_t>(static_cast<int64_t>(lists_.size()) - list_[v]);
      degree_[v] = static_cast<int32_t>(degree);
      left_ += weight_[v];
    }
    for (int32_t v : dense_) weight_[v] = 0;
  }

  void insert(int32_t v) {
    const int32_t d = degree_[v];
    next_[v] = buckets_[d];
    previous_[v] = none;
    if (buckets_[d] != none) previous_[buckets_[d]] = v;
    buckets_[d] = v;
    lowest_ = std::min(lowest_, d);
  }

  void remove(int32_t v) {
    if (frozen(v)) return;
    if (next_[v] != none) previous_[next_[v]] = previous_[v];
    if (previous_[v] != none) {
      next_[previous_[v]] = next_[v];
    } else {
      buckets_[degree_[v]] = next_[v];
    }
  }

  int32_t lowest() {
    while (buckets_[lowest_] == none) ++lowest_;
    const int32_t v = buckets_[lowest_];
    remove(v);
    return v;
  }

  // Joins the members of `child` to those of `parent`: they will be ordered right after it.
  void follow(int32_t parent, int32_t child) {
    follower_[tail_[parent]] = child;
    tail_[parent] = tail_[child];
  }

  // Moves all live lists to the front of the workspace, keeping their order in it.
  void compact() {
    std::vector<int32_t> live;
    for (int32_t v = 0; v < n_; ++v) {
      if (!dead_[v] && length_[v] > 0) live.push_back(v);
    }
    std::sort(live.begin(), live.end(), [this](int32_t a, int32_t b) { return list_[a] < list_[b]; });
    int64_t to = 0;
    for (int32_t v : live) {
      const int64_t from = list_[v];
      list_[v] = to;
      for (int32_t k = 0; k < length_[v]; ++k) lists_[to++] = lists_[from + k];
    }
    lists_.resize(static_cast<size_t>(to));
  }

  void eliminate(int32_t pivot) {
    form_element(pivot);
    measure_elements(pivot);
    update_degrees(pivot);
    merge_indistinguishable(pivot);
    settle(pivot);
  }

  // The new element: the union of the pivot's neighbours and of its elements' variables, which it absorbs. While a
  // pivot is in hand its variables carry negative weight, as a mark.
  void form_element(int32_t pivot) {
    pivot_weight_ = weight_[pivot];
    weight_[pivot] = -pivot_weight_;
    free_ -= pivot_weight_;
    left_ -= pivot_weight_;
    element_degree_ = 0;
    const auto take = [this](int32_t v) {
      element_degree_ += weight_[v];
      weight_[v] = -weight_[v];
      remove(v);
    };
    if (elements_[pivot] == 0) {
      int64_t to = list_[pivot];
      for (int64_t k = list_[pivot], end = k + length_[pivot]; k < end; ++k) {
        const int32_t v = lists_[k];
        if (weight_[v] <= 0) continue;
        take(v);
        lists_[to++] = v;
      }
      length_[pivot] = static_cast<int32_t>(to - list_[pivot]);
      return;
    }
    int64_t need = length_[pivot] - elements_[pivot];
    for (int32_t k = 0; k < elements_[pivot]; ++k) need += length_[lists_[list_[pivot] + k]];
    if (lists_.size() + static_cast<size_t>(need) > lists_.capacity()) {
      compact();
      if (lists_.size() + static_cast<size_t>(need) > lists_.capacity()) {
        lists_.reserve(lists_.size() + lists_.size() / 2 + static_cast<size_t>(need));
      }
    }
    const auto start = static_cast<int64_t>(lists_.size());
    const auto copy = [&](int64_t from, int64_t count) {
      for (int64_t k = from; k < from + count; ++k) {
        const int32_t v = lists_[k];
        if (weight_[v] <= 0) continue;
        take(v);
        lists_.push_back(v);
      }
    };
    for (int32_t k = 0; k < elements_[pivot]; ++k) {
      const int32_t e = lists_[list_[pivot] + k];
      copy(list_[e], length_[e]);
      absorb(e);
    }
    copy(list_[pivot] + elements_[pivot], length_[pivot] - elements_[pivot]);
    list_[pivot] = start;
    length_[pivot] = static_cast<int32_t>(static_cast<int64_t>(lists_.size()) - start);
    elements_[pivot] = 0;
  }

  void absorb(int32_t element) {
    dead_[element] = 1;
    mark_[element] = 0;
  }

  // mark - stamp of an element becomes the weight of its variables outside the new one.
  void measure_elements(int32_t pivot) {
    stamp_ += largest_degree_ + 1;
    largest_degree_ = std::max<int64_t>(largest_degree_, element_degree_);
    for (int32_t a = 0; a < length_[pivot]; ++a) {
      const int32_t v = lists_[list_[pivot] + a];
      for (int64_t k = list_[v], end = k + elements_[v]; k < end; ++k) {
        const int32_t e = lists_[k];
        if (mark_[e] >= stamp_) {
          mark_[e] += weight_[v];  // negative
        } else if (mark_[e] != 0) {
          mark_[e] = degree_[e] + stamp_ + weight_[v];
        }
      }
    }
  }

  void update_degrees(int32_t pivot) {
    for (int32_t a = 0; a < length_[pivot]; ++a) {
      const int32_t v = lists_[list_[pivot] + a];
      const int64_t begin = list_[v];
      const int64_t variables = begin + elements_[v];
      const int64_t end = begin + length_[v];
      int64_t degree = 0;
      uint32_t hash = 0;
      int64_t to = begin;
      for (int64_t k = begin; k < variables; ++k) {
        const int32_t e = lists_[k];
        if (mark_[e] == 0) continue;
        const int64_t outside = mark_[e] - stamp_;
        if (outside > 0) {
          degree += outside;
          lists_[to++] = e;
          hash += static_cast<uint32_t>(e);
        } else {
          absorb(e);  // it lies wholly inside the new element
        }
      }
      const int64_t kept_elements = to - begin;
      const int64_t first_variable = to;
      for (int64_t k = variables; k < end; ++k) {
        const int32_t u = lists_[k];
        if (weight_[u] <= 0) continue;
        degree += weight_[u];
        lists_[to++] = u;
        hash += static_cast<uint32_t>(u);
      }
      if (kept_elements == 0 && to == first_variable && !frozen(v)) {
        const int32_t weight = -weight_[v];
        follow(pivot, v);
        weight_[v] = 0;
        dead_[v] = 1;
        element_degree_ -= weight;
        pivot_weight_ += weight;
        free_ -= weight;
        left_ -= weight;
        continue;
      }
      degree_[v] = static_cast<int32_t>(std::min<int64_t>(degree_[v], degree));
      // The new element goes first; the entry it displaces moves to the end of its part.
      lists_[to] = lists_[first_variable];
      lists_[first_variable] = lists_[begin];
      lists_[begin] = pivot;
      elements_[v] = static_cast<int32_t>(kept_elements + 1);
      length_[v] = static_cast<int32_t>(to - begin + 1);
      hash_[v] = static_cast<int32_t>((hash + static_cast<uint32_t>(pivot)) & (hash_head_.size() - 1));
      previous_[v] = hash_head_[hash_[v]];  // degree links are free while v is out of the buckets
      hash_head_[hash_[v]] = v;
    }
    degree_[pivot] = static_cast<int32_t>(element_degree_);
    largest_degree_ = std::max<int64_t>(largest_degree_, element_degree_);
    stamp_ += largest_degree_ + 1;
  }

  void merge_indistinguishable(int32_t pivot) {
    for (int32_t a = 0; a < length_[pivot]; ++a) {
      const int32_t member = lists_[list_[pivot] + a];
      if (weight_[member] >= 0) continue;
      int32_t i = hash_head_[hash_[member]];
      hash_head_[hash_[member]] = none;
      for (; i != none && previous_[i] != none; i = previous_[i]) {
        ++stamp_;
        for (int64_t k = list_[i] + 1; k < list_[i] + length_[i]; ++k) mark_[lists_[k]] = stamp_;
        int32_t last = i;
        for (int32_t j = previous_[i]; j != none;) {
          bool same = length_[j] == length_[i] && elements_[j] == elements_[i] && stage(i) == stage(j);
          for (int64_t k = list_[j] + 1; same && k < list_[j] + length_[j]; ++k) same = mark_[lists_[k]] == stamp_;
          const int32_t after = previous_[j];
          if (same) {
            follow(i, j);
            weight_[i] += weight_[j];
            weight_[j] = 0;
            dead_[j] = 1;
            previous_[last] = after;
          } else {
            last = j;
          }
          j = after;
        }
        if (previous_[i] == none) break;
      }
    }
    ++stamp_;
  }

  // Restores the weights, gives the survivors their new degrees and drops the merged from the element's list.
  void settle(int32_t pivot) {
    int64_t to = list_[pivot];
    for (int64_t k = to, end = to + length_[pivot]; k < end; ++k) {
      const int32_t v = lists_[k];
      if (weight_[v] == 0) continue;
      const int32_t weight = -weight_[v];
      weight_[v] = weight;
      const int64_t bound = std::min<int64_t>(degree_[v] + element_degree_ - weight, left_ - weight);
      degree_[v] = static_cast<int32_t>(std::max<int64_t>(bound, 0));
      if (!frozen(v)) insert(v);
      lists_[to++] = v;
    }
    length_[pivot] = static_cast<int32_t>(to - list_[pivot]);
    if (length_[pivot] == 0) absorb(pivot);
    weight_[pivot] = 0;
  }

  int32_t n_;
  const std::vector<uint8_t>& stage_;
  int now_ = -1;
  std::vector<int32_t> weight_;          // of a supervariable; 0: element, merged or set aside
  std::vector<int64_t> list_;            // where the list of a variable or an element begins in lists_
  std::vector<int32_t> length_;          // of that list
  std::vector<int32_t> elements_;        // how many elements stand first in a variable's list
  std::vector<int32_t> degree_;          // weighted bound of a variable; exact weight of an element's variables
  std::vector<int64_t> mark_;            // 0: absorbed
  std::vector<int32_t> next_, previous_;  // degree buckets; previous_ also chains equal hashes
  std::vector<int32_t> tail_, follower_;  // members of each supervariable, in the order of elimination
  std::vector<uint8_t> dead_;
  std::vector<int32_t> buckets_, hash_head_, hash_, lists_, dense_;
  int64_t stamp_ = 2, largest_degree_ = 0, element_degree_ = 0, left_ = 0, free_ = 0;
  int32_t lowest_ = 0, pivot_weight_ = 0;
};

}  // namespace

int64_t dense_degree(int32_t vertices) {
  return std::max<int64_t>(24, static_cast<int64_t>(10 * std::sqrt(static_cast<double>(vertices))));
}

std::vector<int32_t> minimum_degree(const Graph& graph, const std::vector<uint8_t>& stage) {
  return MinimumDegree(graph, stage).order();
}

}  // namespace teamslam
