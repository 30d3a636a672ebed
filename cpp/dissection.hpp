// Vertex separators, the working part of nested dissection. Internal to the ordering.
#pragma once

#include <cstdint>
#include <vector>

namespace teamslam {

// A weighted graph that can be coarsened: vertex weights count unknowns, edge weights count collapsed edges.
struct WeightedGraph {
  std::vector<int32_t> start;  // size n + 1
  std::vector<int32_t> neighbour, edge_weight;
  std::vector<int32_t> weight;
  int64_t total = 0;  // of weight

  int32_t size() const { return static_cast<int32_t>(weight.size()); }
};

// Sides of a vertex separator: no edge joins `left` and `right`.
enum Side : uint8_t { left = 0, right = 1, separator = 2 };

struct Separation {
  std::vector<uint8_t> side;
  int64_t weight[3] = {0, 0, 0};
};

// Neither side may hold more than this part of the weight.
inline int64_t side_limit(int64_t total) { return total * 3 / 5; }

// Whether a is better than b: balanced first, then by separator weight over the product of both sides' weights.
bool better(const Separation& a, const Separation& b, int64_t total);

// Improves a separation by pairs of passes of moves out of the separator (Fiduccia and Mattheyses 1982, on vertices
// as in Hendrickson and Rothberg 1998).
void refine(const WeightedGraph& graph, Separation& separation, int passes);

// A good separation of the graph by coarsening, separating the coarsest graph and refining on the way back.
Separation multilevel_separation(const WeightedGraph& graph);

// The same from positions (graph.size() x 3, row-major): the best of several straight cuts, refined.
Separation geometric_separation(const WeightedGraph& graph, const std::vector<double>& positions);

}  // namespace teamslam
