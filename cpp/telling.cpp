#include "telling.hpp"

#include <algorithm>
#include <vector>

#include "checks.hpp"
#include "dense.hpp"
#include "lie.hpp"

namespace teamslam {

namespace {

using Numbers = std::vector<double>;
using Places = std::vector<int64_t>;

int64_t padded(int64_t count) { return (count + 3) & ~int64_t{3}; }

// Log(S' R).
template <int D>
void turn_between(const double* R, const double* S, double* w) {
  double from[D * D], to[D * D], between[D * D];
  std::copy_n(S, D * D, from), std::copy_n(R, D * D, to);
  multiply_transposed<D>(from, to, between);
  const RotationVector<D> found = log_rotation(between);
  std::copy_n(found.w, turn_dof(D), w);
}

// x (-) y of a variable that moves by itself.
void minus(Kind kind, const double* x, const double* y, double* out) {
  const int d = dimension(kind);
  for (int i = 0; i < d; ++i) out[i] = x[i] - y[i];
  if (kind == Kind::pose2) turn_between<2>(x + d, y + d, out + d);
  if (kind == Kind::pose3) turn_between<3>(x + d, y + d, out + d);
}

// The unknowns of the variables at some places.
Places unknowns_of(const Moving& order, const Places& places) {
  Places out;
  for (int64_t v : places)
    for (int64_t i = order.unknown[v]; i < order.unknown[v + 1]; ++i) out.push_back(i);
  return out;
}

// What the filter holds of the map: its unknowns here and there, and how far each is from where the map has it. Without
// those that the map holds for certain.
struct Shared {
  Places here, there;
  Numbers shift;
};
Shared shared_of(const Held& filter, const Held& map, const int64_t* theirs) {
  Shared out;
  const int64_t M = map.order.unknowns();
  for (int64_t v = 0, n = 0; v < filter.order.count(); ++v) {
    if (filter.order.turns[v]) continue;
    const int64_t w = theirs[n++];
    const Kind kind = filter.order.kind[v];
    if (kind != map.order.kind[w]) refuse("variable ", v, " is a ", name_of(kind), " and another kind in the map");
    double away[most_dof];
    minus(kind, filter.of.state + filter.order.number[v], map.of.state + map.order.number[w], away);
    for (int i = 0; i < dof(kind); ++i) {
      const int64_t column = map.order.unknown[w] + i;
      if (!(map.of.covariance[column * (M + 1)] > 0.0)) continue;
      out.here.push_back(filter.order.unknown[v] + i), out.there.push_back(column), out.shift.push_back(away[i]);
    }
  }
  return out;
}

// G, column-major, `high` apart; false where S_ss is not positive.
bool slope_of(const double* S, int64_t M, const Places& s, const Places& j, int64_t high, Numbers& G) {
  const int64_t n = s.size(), leading = padded(n);
  Numbers L(leading * leading), inverse(n), lowest(n);
  for (int64_t c = 0; c < n; ++c) {
    for (int64_t r = c; r < n; ++r) L[r + c * leading] = S[s[c] * M + s[r]];
    for (size_t r = 0; r < j.size(); ++r) G[r + c * high] = S[s[c] * M + j[r]];
  }
  const DenseKernels& dense = dense_kernels();
  if (dense.factor(n, L.data(), leading, lowest.data(), inverse.data()) >= 0) return false;
  dense.divide_transposed(high, n, L.data(), leading, inverse.data(), G.data(), high);
  dense.divide(high, n, L.data(), leading, inverse.data(), G.data(), high);
  return all_finite(G.data(), G.size());
}

}  // namespace

bool told(const Held& filter, const Held& map, const int64_t* theirs, int64_t count, const int64_t* fresh, double* state,
          double* covariance) {
  const Places marks(fresh, fresh + count), j = unknowns_of(map.order, marks);
  const Shared shared = shared_of(filter, map, theirs);
  const int64_t N = filter.order.unknowns(), M = map.order.unknowns(), m = j.size(), n = shared.here.size();
  const int64_t high = padded(m), all = N + m;
  const double *P = filter.of.covariance, *S = map.of.covariance;
  Numbers G(high * n);
  if (!slope_of(S, M, shared.there, j, high, G)) return false;

  Numbers delta(M), moved(map.order.numbers());
  for (int64_t c = 0; c < n; ++c)
    for (int64_t i = 0; i < m; ++i) delta[j[i]] += G[i + c * high] * shared.shift[c];
  map.order.retract(map.of.state, delta.data(), moved.data());
  double* next = std::copy_n(filter.of.state, filter.order.numbers(), state);
  for (int64_t v : marks)
    next = std::copy(moved.data() + map.order.number[v], moved.data() + map.order.number[v + 1], next);

  for (int64_t i = 0; i < N; ++i) std::copy_n(P + i * N, N, covariance + i * all);
  for (int64_t i = 0; i < m; ++i) {
    double* row = covariance + (N + i) * all;
    std::fill_n(row, N, 0.0);
    for (int64_t c = 0; c < n; ++c) {
      const double g = G[i + c * high], *known = P + shared.here[c] * N;
      for (int64_t k = 0; k < N; ++k) row[k] += g * known[k];
    }
    for (int64_t k = 0; k <= i; ++k) {
      double own = S[j[i] * M + j[k]];
      for (int64_t c = 0; c < n; ++c)
        own += G[k + c * high] * row[shared.here[c]] - G[i + c * high] * S[shared.there[c] * M + j[k]];
      row[N + k] = covariance[(N + k) * all + N + i] = own;
    }
    for (int64_t k = 0; k < N; ++k) covariance[k * all + N + i] = row[k];
  }
  return true;
}

}  // namespace teamslam
