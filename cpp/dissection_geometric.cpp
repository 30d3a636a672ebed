// Geometric bisection: see dissection.hpp. Maps are nearly planar and sightings short, so a straight line through the
// map crosses few of them. Lines of several directions are swept over the map, and the one of least ratio cut
// (edge weight crossed over the product of both sides' weights), within the balance allowed, is made a vertex separator
// and refined. Lines are tried between bands, so that a sweep needs no sorting.
#include <algorithm>
#include <array>
#include <vector>

#include "dissection.hpp"

namespace teamslam {
namespace {

constexpr int directions = 4;
constexpr double direction[directions][3] = {{1, 0, 0}, {0, 1, 0}, {0.7, 0.7, 0}, {0.7, -0.7, 0}};

// How the bands are laid: a balanced cut lies between these parts of the vertices, and outside them one band will do.
constexpr double band_begin = 0.25, band_end = 0.75;
constexpr int32_t bands = 512;
constexpr size_t sample_size = 1024;

using Bands = std::array<uint16_t, directions>;  // of one vertex, across every direction

// All vertices in bands, equally wide between two quantiles of a sample.
std::vector<Bands> in_bands(const WeightedGraph& graph, const std::vector<double>& positions) {
  const auto n = static_cast<size_t>(graph.size());
  std::vector<Bands> result(n);
  std::vector<double> sample;
  for (int k = 0; k < directions; ++k) {
    const double* d = direction[k];
    const auto along = [&](size_t v) {
      return d[0] * positions[3 * v] + d[1] * positions[3 * v + 1] + d[2] * positions[3 * v + 2];
    };
    sample.clear();
    for (size_t v = 0; v < n; v += n / sample_size + 1) sample.push_back(along(v));
    const auto quantile = [&](double part) {
      const auto at = sample.begin() + static_cast<std::ptrdiff_t>(part * static_cast<double>(sample.size() - 1));
      std::nth_element(sample.begin(), at, sample.end());
      return *at;
    };
    const double begin = quantile(band_begin), width = (quantile(band_end) - begin) / (bands - 2);
    const double scale = width > 0 ? 1 / width : 0;
    for (size_t v = 0; v < n; ++v) {
      result[v][k] = static_cast<uint16_t>(std::clamp((along(v) - begin) * scale + 1, 0.0, bands - 1.0));
    }
  }
  return result;
}

struct Line {
  int direction = -1;  // negative: none is balanced
  int32_t last = 0;    // band on the left
  double score = 0;
};

// The best line between two bands of any direction.
Line best_line(const WeightedGraph& graph, const std::vector<Bands>& band) {
  struct Step {
    int64_t weight = 0, crossing = 0;  // in a band, and how much more edge weight crosses the line behind it
  };
  std::vector<std::array<Step, directions>> step(bands);
  for (int32_t v = 0; v < graph.size(); ++v) {
    std::array<int32_t, directions> ahead{};  // edge weight to later bands less that to earlier ones
    for (int32_t k = graph.start[v]; k < graph.start[v + 1]; ++k) {
      const Bands& other = band[graph.neighbour[k]];
      const int32_t weight = graph.edge_weight[k];
      for (int d = 0; d < directions; ++d) {
        ahead[d] += ((band[v][d] < other[d]) - (band[v][d] > other[d])) * weight;
      }
    }
    for (int d = 0; d < directions; ++d) {
      step[band[v][d]][d].weight += graph.weight[v];
      step[band[v][d]][d].crossing += ahead[d];
    }
  }
  Line best;
  for (int d = 0; d < directions; ++d) {
    int64_t crossed = 0, passed = 0;
    for (int32_t b = 0; b + 1 < bands; ++b) {
      crossed += step[b][d].crossing;
      passed += step[b][d].weight;
      if (step[b][d].weight == 0 || 5 * passed < 2 * graph.total || 5 * passed > 3 * graph.total) continue;
      const double score =
          static_cast<double>(crossed) / (static_cast<double>(passed) * static_cast<double>(graph.total - passed));
      if (best.direction < 0 || score < best.score) best = {d, b, score};
    }
  }
  return best;
}

// `left` is what lies before the line; of every edge cut, the end on the lighter side of the cut's border joins the
// separator.
Separation border(const WeightedGraph& graph, const std::vector<Bands>& band, const Line& line) {
  Separation sides;
  sides.side.resize(band.size());
  for (size_t v = 0; v < band.size(); ++v) sides.side[v] = band[v][line.direction] <= line.last ? left : right;
  Separation best;
  for (int from = 0; from < 2; ++from) {
    Separation trial = sides;
    for (int32_t v = 0; v < graph.size(); ++v) {
      if (sides.side[v] != from) continue;
      for (int32_t k = graph.start[v]; k < graph.start[v + 1]; ++k) {
        if (sides.side[graph.neighbour[k]] == 1 - from) {
          trial.side[v] = separator;
          break;
        }
      }
    }
    for (int32_t v = 0; v < graph.size(); ++v) trial.weight[trial.side[v]] += graph.weight[v];
    if (from == 0 || better(trial, best, graph.total)) best = std::move(trial);
  }
  return best;
}

}  // namespace

Separation geometric_separation(const WeightedGraph& graph, const std::vector<double>& positions) {
  const std::vector<Bands> band = in_bands(graph, positions);
  const Line line = best_line(graph, band);
  if (line.direction < 0) return multilevel_separation(graph);  // one vertex, or one place, outweighs the balance
  Separation result = border(graph, band, line);
  refine(graph, result, 4);
  return result;
}

}  // namespace teamslam
