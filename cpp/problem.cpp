#include "problem.hpp"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <utility>

#include "checks.hpp"
#include "threads.hpp"

namespace teamslam {

namespace {

// Multiplications in a chunk: about 0.2 ms, so that a chunk repays the handover to another thread.
constexpr double chunk_work = 5e5;
constexpr int32_t most_chunks = 64;

double sum_of(const std::vector<double>& numbers) {
  double sum = 0.0;
  for (double number : numbers) sum += number;
  return sum;
}

Variables variables_of(int64_t count, const int32_t* kinds_, const uint8_t* fixed) {
  if (count <= 0) refuse("a problem needs at least one variable");
  Variables variables;
  variables.offset.push_back(0);
  int32_t free = 0;
  for (int64_t v = 0; v < count; ++v) {
    if (kinds_[v] < 0 || kinds_[v] >= kinds)
      refuse("variable ", v, " has kind ", kinds_[v], "; expected 0 pose2, 1 pose3, 2 point2 or 3 point3");
    const Kind kind = static_cast<Kind>(kinds_[v]);
    variables.kind.push_back(kind);
    variables.offset.push_back(variables.offset.back() + numbers(kind));
    variables.free.push_back(fixed[v] ? held : free++);
  }
  return variables;
}

}  // namespace

Problem::Problem(int64_t variables, const int32_t* kinds_, const uint8_t* fixed)
    : variables_(variables_of(variables, kinds_, fixed)), retraction_(variables_) {
  for (int64_t v = 0; v < variables; ++v)
    if (!fixed[v]) free_variables_.push_back(static_cast<int32_t>(v));
}

void Problem::check_open() const {
  if (frozen_) refuse("the problem's structure is fixed by its first use; add all terms before");
}

int64_t Problem::add_table(const TableInput& input) {
  check_open();
  terms_.push_back(std::make_unique<Table>(variables_, input));
  return static_cast<int64_t>(terms_.size()) - 1;
}

int64_t Problem::add_submaps(int64_t count, const std::function<SubmapInput(int64_t)>& input, int threads) {
  check_open();
  std::vector<std::unique_ptr<Term>> made(count);
  share_out(count, threads, [&](int64_t i) { made[i] = std::make_unique<SubmapTerm>(variables_, input(i)); });
  const int64_t first = static_cast<int64_t>(terms_.size());
  std::move(made.begin(), made.end(), std::back_inserter(terms_));
  return first;
}

int64_t Problem::add_blocks(int64_t count, int64_t keys, const int64_t* index, int64_t residual_rows) {
  check_open();
  terms_.push_back(std::make_unique<UserBlocks>(variables_, count, keys, index, residual_rows));
  return static_cast<int64_t>(terms_.size()) - 1;
}

template <class Kind_>
Kind_& Problem::find(int64_t handle, const char* name) {
  Kind_* term = nullptr;
  if (handle >= 0 && handle < static_cast<int64_t>(terms_.size()))
    term = dynamic_cast<Kind_*>(terms_[static_cast<std::size_t>(handle)].get());
  if (term == nullptr) refuse("handle ", handle, " is no ", name, " of this problem");
  return *term;
}

template Term& Problem::find<Term>(int64_t, const char*);
template Table& Problem::find<Table>(int64_t, const char*);
template SubmapTerm& Problem::find<SubmapTerm>(int64_t, const char*);
template UserBlocks& Problem::find<UserBlocks>(int64_t, const char*);

void Problem::freeze() {
  if (frozen_) return;
  const std::vector<int32_t> chunk_of_variable = cut_into_chunks();
  Couplings couplings;
  for (auto& term : terms_) {
    term->arrange(chunk_of_variable, chunks_);
    term->couple(couplings);
  }
  std::vector<int32_t> dofs;
  for (int32_t v : free_variables_) dofs.push_back(dof(variables_.kind[v]));
  std::vector<int64_t> block_of_slot;
  pattern_ = couplings.pattern(std::move(dofs), block_of_slot);
  place_terms(block_of_slot);
  frozen_ = true;
}

// Runs of consecutive variables with about equal work, whatever the number of threads.
std::vector<int32_t> Problem::cut_into_chunks() {
  std::vector<double> work(variables_.count(), 0.0);
  for (const auto& term : terms_) term->weigh(work);
  const double total = sum_of(work);
  chunks_ = static_cast<int32_t>(std::clamp(total / chunk_work, 1.0, static_cast<double>(most_chunks)));
  std::vector<int32_t> chunk_of_variable(variables_.count());
  double before = 0.0;
  for (int64_t v = 0; v < variables_.count(); ++v) {
    const double share = total > 0.0 ? before / total : 0.0;
    chunk_of_variable[v] = std::min(chunks_ - 1, static_cast<int32_t>(share * chunks_));
    before += work[v];
  }
  return chunk_of_variable;
}

void Problem::place_terms(const std::vector<int64_t>& block_of_slot) {
  Layout layout(pattern_, block_of_slot);
  for (int32_t chunk = 0; chunk < chunks_; ++chunk) {
    layout.claim(chunk);
    for (auto& term : terms_) term->place(chunk, layout);
  }
  for (int32_t chunk = 0; chunk < chunks_; ++chunk) {
    layout.place(chunk);
    for (auto& term : terms_) term->place(chunk, layout);
  }
  system_size_ = layout.size();
  spills_ = layout.spills();
}

double Problem::linearise(const double* state, const std::vector<UserLinearisation>& user, int threads,
                          double* system) {
  freeze();
  std::fill_n(system, system_size_, 0.0);
  std::vector<const UserBlocks*> user_blocks;
  for (const UserLinearisation& part : user) user_blocks.push_back(&blocks(part.handle));
  std::vector<double> costs(chunks_, 0.0);
  share_out(chunks_, threads, [&](int64_t chunk) {
    for (const auto& term : terms_) costs[chunk] += term->linearise(chunk, state, system);
    for (std::size_t i = 0; i < user.size(); ++i) user_blocks[i]->add(chunk, user[i].e, user[i].J, system);
  });
  for (const Layout::Spill& spill : spills_)
    for (int64_t i = 0; i < spill.length; ++i) system[spill.target + i] += system[spill.source + i];
  return sum_of(costs);
}

double Problem::slope(const double* state, int threads, double* system) {
  freeze();
  std::fill(system + pattern_.size(), system + system_size_, 0.0);
  std::vector<double> costs(chunks_, 0.0);
  share_out(chunks_, threads, [&](int64_t chunk) {
    for (const auto& term : terms_) costs[chunk] += term->slope(chunk, state, system);
  });
  for (const Layout::Spill& spill : spills_)
    for (int64_t i = 0; i < spill.length && spill.target >= pattern_.size(); ++i)
      system[spill.target + i] += system[spill.source + i];
  return sum_of(costs);
}

double Problem::cost(const double* state, int threads) const {
  std::vector<double> costs(chunks_, 0.0);
  share_out(chunks_, threads, [&](int64_t chunk) {
    for (const auto& term : terms_) costs[chunk] += term->cost(chunk, state);
  });
  return sum_of(costs);
}

double Problem::sharpest() const {
  double most = 0.0;
  for (const auto& term : terms_) most = std::max(most, term->sharpest());
  return most;
}

void Problem::check_state(const double* state) const {
  const bool finite = all_finite(state, variables_.numbers());
  for (int64_t v = 0; v < variables_.count(); ++v) {
    const Kind kind = variables_.kind[v];
    const double* x = state + variables_.offset[v];
    if (!finite && !all_finite(x, numbers(kind))) refuse("the state of variable ", v, " is not finite");
    if (is_pose(kind) && !is_rotation(x + dimension(kind), dimension(kind)))
      refuse("the rotation of variable ", v, " is none; expected T, then R row by row");
  }
}

}  // namespace teamslam
