#include "submap_term.hpp"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "block_products.hpp"
#include "checks.hpp"
#include "models_pose.hpp"
#include "models_sighting.hpp"

namespace teamslam {

namespace {

template <int D>
Pose<D> frame_of(Kind kind, const double* x) {  // x null: the world
  if (x == nullptr) {
    Pose<D> identity{};
    for (int i = 0; i < D; ++i) identity.R[(D + 1) * i] = 1.0;
    return identity;
  }
  return load_any_pose<D>(kind, x);
}

// A variable's view of the frame and of the member, as Jacobians of the local estimate's residual.
struct Residual {
  double e[6];
  double J_base[largest_jacobian], J_member[largest_jacobian];  // estimate's unknowns x lifted unknowns
  int rows = 0, base_columns = 0, member_columns = 0;
};

template <int D>
void pose_residual(const double* s, Kind base, const double* x_b, Kind kind, const double* x_v, Residual& r) {
  const Pose<D> z = load_pose<D, D == 2 ? Kind::pose2 : Kind::pose3>(s);
  relate<D, true>(z, frame_of<D>(base, x_b), frame_of<D>(kind, x_v), r.e, r.J_base, r.J_member);
  r.rows = r.base_columns = r.member_columns = pose_dof(D);
}

// A point may be the estimate of whatever has a place: of a pose it is where that is; of what lives in the plane, at
// height 0; of what lives in space, seen in the plane, its shadow.
template <int D>
void point_residual(const double* s, Kind base, const double* x_b, Kind kind, const double* x_v, Residual& r) {
  double p[D] = {};
  std::copy_n(x_v, std::min(D, dimension(kind)), p);
  sight<PointMeasure<D>, D, true>(s, frame_of<D>(base, x_b), p, r.e, r.J_base, r.J_member);
  r.rows = r.member_columns = D, r.base_columns = pose_dof(D);
}

void residual_of(Kind estimate, const double* s, Kind base, const double* x_b, Kind kind, const double* x_v,
                 Residual& r) {
  switch (estimate) {
    case Kind::pose2: return pose_residual<2>(s, base, x_b, kind, x_v, r);
    case Kind::pose3: return pose_residual<3>(s, base, x_b, kind, x_v, r);
    case Kind::point2: return point_residual<2>(s, base, x_b, kind, x_v, r);
    case Kind::point3: return point_residual<3>(s, base, x_b, kind, x_v, r);
  }
}

// The Jacobian of a pose in D dimensions, by the unknowns of a frame of this kind.
void take_pose_columns(const double* J, int rows, int columns, Kind kind, double* out, int stride) {
  const int D = columns == 6 ? 3 : 2;
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < dof(kind); ++j) out[stride * i + j] = J[columns * i + pose_column(kind, D, j)];
}

// The Jacobian of what a member's estimate is of, by the member's unknowns.
void take_member_columns(Kind estimate, const Residual& r, Kind kind, double* out, int stride) {
  if (is_pose(estimate)) return take_pose_columns(r.J_member, r.rows, r.member_columns, kind, out, stride);
  for (int i = 0; i < r.rows; ++i)
    for (int j = 0; j < dof(kind); ++j) {
      const int column = point_column(kind, r.member_columns, j);
      out[stride * i + j] = column < 0 ? 0.0 : r.J_member[r.member_columns * i + column];
    }
}

// Whether an estimate of one kind can be of a variable of another.
bool can_be_of(Kind estimate, Kind variable) {
  return estimate == variable || !is_pose(estimate) || (estimate == Kind::pose3 && variable == Kind::pose2);
}

}  // namespace

// What one linearisation works with. X = [A_b, e] and Y = I X, row-major, `width` columns, e in the last; A_b (d_b
// columns) is absent where there is no free base.
struct SubmapTerm::Work {
  int d_b, width;
  std::vector<double> A;  // A_v: `largest_jacobian` numbers each, estimate's unknowns x variable's, row-major
  std::vector<double> X, Y;
};

SubmapTerm::SubmapTerm(const Variables& variables, SubmapInput input)
    : variables_(variables),
      base_(static_cast<int32_t>(input.base)),
      pattern_(std::move(input.pattern)),
      values_(std::move(input.values)) {
  const int64_t count = variables.count();
  if (input.members <= 0) refuse("submap: it has no members");
  if (input.base < -1 || input.base >= count)
    refuse("submap: the base is variable ", input.base, ", but there are ", count, " (-1: the frame is the world's)");
  if (base_ >= 0 && !is_pose(variables_.kind[base_])) refuse("submap: the base is not a pose");
  check_members(input);
  int64_t numbers_so_far = 0;
  members_.reserve(input.members);
  for (int64_t i = 0; i < input.members; ++i) {
    const Kind kind = static_cast<Kind>(input.kind[i]);
    members_.push_back({static_cast<int32_t>(input.member[i]), kind, numbers_so_far, 0, 0, held, 0});
    numbers_so_far += numbers(kind);
  }
  check_pattern();
  state_.assign(input.state, input.state + numbers_so_far);
  eta_.assign(pattern_.scalars(), 0.0);
  if (input.eta != nullptr) std::copy_n(input.eta, eta_.size(), eta_.data());
  check_numbers(state_.data(), values_.data(), eta_.data());
}

void SubmapTerm::check_members(const SubmapInput& input) const {
  const int64_t count = variables_.count();
  std::vector<int64_t> sorted(input.member, input.member + input.members);
  std::sort(sorted.begin(), sorted.end());
  for (int64_t i = 0; i < input.members; ++i) {
    const int64_t variable = input.member[i];
    if (variable < 0 || variable >= count)
      refuse("submap: member ", i, " names variable ", variable, ", but there are ", count);
    if (variable == base_ || (i > 0 && sorted[i] == sorted[i - 1]))
      refuse("submap: variable ", variable == base_ ? variable : sorted[i], " comes twice, or is the base");
  }
  for (int64_t i = 0; i < input.members; ++i) {
    const Kind kind = static_cast<Kind>(input.kind[i]), global = variables_.kind[input.member[i]];
    if (!can_be_of(kind, global))
      refuse("submap: member ", i, ": a ", name_of(kind), " cannot be the estimate of a ", name_of(global));
    if (base_ >= 0 && dimension(variables_.kind[base_]) > dimension(kind))
      refuse("submap: member ", i, ": a ", name_of(kind), " cannot be seen from a base in space");
  }
}

void SubmapTerm::check_pattern() const {
  const int64_t n = static_cast<int64_t>(members_.size());
  if (pattern_.column_start[0] != 0) refuse("submap: the information's pattern does not start at block 0");
  for (int64_t c = 0; c < n; ++c) {
    const int64_t begin = pattern_.column_start[c], end = pattern_.column_start[c + 1];
    if (pattern_.dof[c] != dof(members_[c].kind)) refuse("submap: the information does not fit member ", c);
    if (end <= begin || pattern_.row[begin] != c)
      refuse("submap: column ", c, " of the information does not begin with its diagonal block");
    for (int64_t k = begin + 1; k < end; ++k)
      if (pattern_.row[k] <= pattern_.row[k - 1] || pattern_.row[k] >= n)
        refuse("submap: the rows of column ", c, " of the information do not rise within the members");
  }
}

void SubmapTerm::check_numbers(const double* state, const double* values, const double* eta) const {
  if (!all_finite(state, static_cast<int64_t>(state_.size())))
    refuse("submap: the state has a number that is not finite");
  if (!all_finite(values, static_cast<int64_t>(values_.size())))
    refuse("submap: the information has a number that is not finite");
  if (eta && !all_finite(eta, static_cast<int64_t>(eta_.size())))
    refuse("submap: eta has a number that is not finite");
  for (std::size_t i = 0; i < members_.size(); ++i) {
    const int D = dimension(members_[i].kind);
    if (is_pose(members_[i].kind) && !is_rotation(state + members_[i].state + D, D))
      refuse("submap: the rotation of member ", i, " is none; expected T, then R row by row");
  }
}

void SubmapTerm::set(const double* state, const double* values, const double* eta) {
  check_numbers(state, values, eta);
  std::copy_n(state, state_.size(), state_.data());
  std::copy_n(values, values_.size(), values_.data());
  if (eta)
    std::copy_n(eta, eta_.size(), eta_.data());
  else
    std::fill(eta_.begin(), eta_.end(), 0.0);
}

int32_t SubmapTerm::owner() const { return base_ >= 0 ? base_ : members_[0].variable; }

void SubmapTerm::weigh(std::vector<double>& work) const {
  work[owner()] += 200.0 * static_cast<double>(members_.size()) + 8.0 * static_cast<double>(pattern_.size());
}

void SubmapTerm::arrange(const std::vector<int32_t>& chunk_of_variable, int32_t) {
  chunk_ = chunk_of_variable[owner()];
}

void SubmapTerm::couple(Couplings& couplings) {
  for (int32_t c = 0; c < pattern_.variables(); ++c)
    for (int64_t k = pattern_.column_start[c] + 1; k < pattern_.column_start[c + 1]; ++k)
      slots_.push_back(couplings.add(free_of(members_[pattern_.row[k]]), free_of(members_[c])));
  if (base_ < 0) return;
  for (Member& member : members_) member.base_slot = couplings.add(free_of(member), variables_.free[base_]);
}

void SubmapTerm::place(int32_t chunk, Layout& layout) {
  if (chunk != chunk_) return;
  const auto placed = [&](int64_t slot, bool transposed) {
    const int64_t start = layout.coupling(slot);
    return transposed ? ~start : start;
  };
  std::vector<int32_t> free;
  for (const Member& member : members_) free.push_back(free_of(member));
  blocks_.resize(slots_.size());
  std::size_t next = 0;
  for (int32_t c = 0; c < pattern_.variables(); ++c)
    for (int64_t k = pattern_.column_start[c] + 1; k < pattern_.column_start[c + 1]; ++k, ++next)
      blocks_[next] = placed(slots_[next], free[pattern_.row[k]] < free[c]);
  for (Member& member : members_) {
    member.diagonal = layout.diagonal(free_of(member));
    member.gradient = layout.gradient(free_of(member));
    if (base_ >= 0) member.base_block = placed(member.base_slot, free_of(member) < variables_.free[base_]);
  }
  if (base_ < 0) return;
  base_diagonal_ = layout.diagonal(variables_.free[base_]);
  base_gradient_ = layout.gradient(variables_.free[base_]);
}

// Evaluates the residual and what else is wanted; returns e'Ie + 2 eta'e.
double SubmapTerm::evaluate(const double* state, Wanted wanted, Work& work) const {
  const Kind base = base_ >= 0 ? variables_.kind[base_] : Kind::pose2;
  const double* x_b = base_ >= 0 ? state + variables_.offset[base_] : nullptr;
  const bool jacobians = wanted != Wanted::cost;
  const bool with_base = jacobians && base_ >= 0 && variables_.free[base_] != held;
  work.d_b = with_base ? dof(base) : 0;
  const int width = work.width = with_base ? even_width(work.d_b) : 1;
  work.X.assign(width * pattern_.scalars(), 0.0);
  work.Y.resize(width * pattern_.scalars());
  if (jacobians) work.A.resize(largest_jacobian * members_.size());
  for (std::size_t i = 0; i < members_.size(); ++i) {
    const Member& member = members_[i];
    const Kind kind = variables_.kind[member.variable];
    Residual r;
    residual_of(member.kind, state_.data() + member.state, base, x_b, kind, state + variables_.offset[member.variable],
                r);
    double* X = work.X.data() + width * pattern_.scalar_start[i];
    for (int row = 0; row < r.rows; ++row) X[width * row + width - 1] = r.e[row];
    if (jacobians)
      take_member_columns(member.kind, r, kind, work.A.data() + largest_jacobian * i, dof(kind));
    if (with_base) take_pose_columns(r.J_base, r.rows, r.base_columns, base, X, width);
  }
  multiply(pattern_, values_.data(), width, wanted == Wanted::all, work.X.data(), work.Y.data());
  double cost = 0.0;
  for (int64_t i = 0; i < pattern_.scalars(); ++i) {
    const double e = work.X[width * i + width - 1];
    double& weighted = work.Y[width * i + width - 1];
    weighted += eta_[i];
    cost += e * (weighted + eta_[i]);
  }
  return cost;
}

void SubmapTerm::add_gradient(const Work& work, double* system) const {
  const int width = work.width;
  double of_base[6] = {};
  for (int32_t c = 0; c < pattern_.variables(); ++c) {
    const int d_c = dof(variables_.kind[members_[c].variable]);
    const double* A_c = work.A.data() + largest_jacobian * c;
    for (int row = 0; row < pattern_.dof[c]; ++row) {
      const double* A_b = work.X.data() + width * (pattern_.scalar_start[c] + row);
      const double weighted = work.Y[width * (pattern_.scalar_start[c] + row) + width - 1];
      for (int p = 0; p < d_c; ++p) system[members_[c].gradient + p] += A_c[d_c * row + p] * weighted;
      for (int p = 0; p < work.d_b; ++p) of_base[p] += A_b[p] * weighted;
    }
  }
  for (int p = 0; p < work.d_b; ++p) system[base_gradient_ + p] += of_base[p];
}

void SubmapTerm::add_members(const Work& work, double* system) const {
  std::vector<int8_t> shape;
  for (std::size_t i = 0; i < members_.size(); ++i)
    shape.push_back(shape_of(pattern_.dof[i], dof(variables_.kind[members_[i].variable])));
  const auto shape_at = [&](int32_t i) { return shape[i]; };
  for (int32_t c = 0; c < pattern_.variables(); ++c) {
    const double *A = work.A.data(), *A_c = A + largest_jacobian * c;
    const int64_t first = pattern_.column_start[c], here = 0;
    double diagonal[largest_jacobian] = {};
    add_runs[shape[c]][shape[c]](values_.data() + pattern_.value_start[first], &c, 1, A, A_c, &here, diagonal);
    add_symmetric(diagonal, dof(variables_.kind[members_[c].variable]), system + members_[c].diagonal);
    for_each_run(pattern_, first + 1, pattern_.column_start[c + 1], shape_at, [&](int64_t begin, int64_t end) {
      add_runs[shape[pattern_.row[begin]]][shape[c]](values_.data() + pattern_.value_start[begin],
                                                     pattern_.row.data() + begin, end - begin, A, A_c,
                                                     blocks_.data() + (begin - c - 1), system);
    });
  }
}

// With E = I A_b, which stands in Y: the base's own block and its blocks with the members.
template <int d_b>
void SubmapTerm::add_base(const Work& work, double* system) const {
  constexpr int width = even_width(d_b);
  double diagonal[d_b * d_b] = {};
  for (int64_t row = 0; row < pattern_.scalars(); ++row) {
    const double *A_b = work.X.data() + width * row, *E = work.Y.data() + width * row;
    for (int p = 0; p < d_b; ++p)
      for (int q = 0; q < d_b; ++q) diagonal[d_b * p + q] += A_b[p] * E[q];
  }
  add_symmetric(diagonal, d_b, system + base_diagonal_);
  for (std::size_t i = 0; i < members_.size(); ++i) {
    const int d_v = dof(variables_.kind[members_[i].variable]);
    const double *A_v = work.A.data() + largest_jacobian * i, *E = work.Y.data() + width * pattern_.scalar_start[i];
    const bool transposed = members_[i].base_block < 0;
    double* target = system + (transposed ? ~members_[i].base_block : members_[i].base_block);
    for (int p = 0; p < d_v; ++p)
      for (int q = 0; q < d_b; ++q) {
        double sum = 0.0;
        for (int row = 0; row < pattern_.dof[i]; ++row) sum += A_v[d_v * row + p] * E[width * row + q];
        target[transposed ? d_b * p + q : d_v * q + p] += sum;
      }
  }
}

// What the residuals' curvature takes from H: by the unknowns of the base and of each member.
void SubmapTerm::subtract_bends(const double* state, const Work& work, double* system) const {
  const bool moving = base_ >= 0 && variables_.free[base_] != held;
  const Kind base = base_ >= 0 ? variables_.kind[base_] : Kind::pose2;
  const double* x_b = base_ >= 0 ? state + variables_.offset[base_] : nullptr;
  const int d_b = moving ? dof(base) : 0;
  for (std::size_t i = 0; i < members_.size(); ++i) {
    const Member& member = members_[i];
    const Kind kind = variables_.kind[member.variable];
    const int n = dof(member.kind), d_v = dof(kind), columns = d_b + d_v;
    double lambda[6], C[144] = {};
    for (int row = 0; row < n; ++row)
      lambda[row] = work.Y[work.width * (pattern_.scalar_start[i] + row) + work.width - 1];
    const auto jacobian_at = [&](const double* b, const double* v, double* J) {
      Residual r;
      residual_of(member.kind, state_.data() + member.state, base, b, kind, v, r);
      if (moving) take_pose_columns(r.J_base, r.rows, r.base_columns, base, J, columns);
      take_member_columns(member.kind, r, kind, J + d_b, columns);
    };
    subtract_bend<6, 12>(base, x_b, kind, state + variables_.offset[member.variable], d_b, d_v, n, lambda, jacobian_at,
                         C);
    for (int p = 0; p < d_v; ++p)
      for (int q = 0; q < d_v; ++q) system[member.diagonal + d_v * p + q] += C[columns * (d_b + p) + d_b + q];
    for (int p = 0; p < d_b; ++p)
      for (int q = 0; q < d_b; ++q) system[base_diagonal_ + d_b * p + q] += C[columns * p + q];
    const bool transposed = member.base_block < 0;
    double* coupling = system + (transposed ? ~member.base_block : member.base_block);
    for (int p = 0; p < d_v; ++p)
      for (int q = 0; q < d_b; ++q) coupling[transposed ? d_b * p + q : d_v * q + p] += C[columns * (d_b + p) + q];
  }
}

double SubmapTerm::linearise(int32_t chunk, const double* state, double* system) const {
  if (chunk != chunk_) return 0.0;
  Work work;
  const double cost = evaluate(state, Wanted::all, work);
  add_gradient(work, system);
  add_members(work, system);
  if (work.d_b == 3) add_base<3>(work, system);
  if (work.d_b == 6) add_base<6>(work, system);
  if (curvature_ == Curvature::all) subtract_bends(state, work, system);
  return cost;
}

double SubmapTerm::slope(int32_t chunk, const double* state, double* system) const {
  if (chunk != chunk_) return 0.0;
  Work work;
  const double cost = evaluate(state, Wanted::slope, work);
  add_gradient(work, system);
  return cost;
}

double SubmapTerm::cost(int32_t chunk, const double* state) const {
  if (chunk != chunk_) return 0.0;
  Work work;
  return evaluate(state, Wanted::cost, work);
}

int64_t SubmapTerm::fault(const double* state) const {
  Work work;
  evaluate(state, Wanted::all, work);
  for (std::size_t i = 0; i < members_.size(); ++i) {
    const int64_t start = work.width * pattern_.scalar_start[i], count = work.width * pattern_.dof[i];
    const int64_t entries = pattern_.dof[i] * dof(variables_.kind[members_[i].variable]);
    if (!all_finite(work.X.data() + start, count) || !all_finite(work.Y.data() + start, count) ||
        !all_finite(work.A.data() + largest_jacobian * i, entries))
      return static_cast<int64_t>(i);
  }
  return -1;
}

// No entry of a positive matrix is larger than the largest of its diagonal.
double SubmapTerm::sharpest() const {
  double most = 0.0;
  for (int32_t c = 0; c < pattern_.variables(); ++c) {
    const double* diagonal = values_.data() + pattern_.value_start[pattern_.column_start[c]];
    for (int32_t i = 0; i < pattern_.dof[c]; ++i) most = std::max(most, diagonal[(pattern_.dof[c] + 1) * i]);
  }
  return most;
}

}  // namespace teamslam
