// A non-linear least-squares problem over poses and points: terms in, linear system out.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "block_matrix.hpp"
#include "layout.hpp"
#include "retraction.hpp"
#include "submap_term.hpp"
#include "table.hpp"
#include "user_blocks.hpp"

namespace teamslam {

// What a user's blocks contribute to one linearisation.
struct UserLinearisation {
  int64_t handle;
  const double* e;
  const double* J;
};

// All checks throw std::invalid_argument. Terms are added first; the first use freezes the structure.
class Problem {
 public:
  Problem(int64_t variables, const int32_t* kinds, const uint8_t* fixed);

  int64_t add_table(const TableInput& input);
  // input(i) gives submap i, on any thread; the handles follow one another from the one returned.
  int64_t add_submaps(int64_t count, const std::function<SubmapInput(int64_t)>& input, int threads);
  int64_t add_blocks(int64_t count, int64_t keys, const int64_t* index, int64_t residual_rows);
  Table& table(int64_t handle) { return find<Table>(handle, "table"); }
  SubmapTerm& submap(int64_t handle) { return find<SubmapTerm>(handle, "submap"); }
  Term& term(int64_t handle) { return find<Term>(handle, "term"); }
  UserBlocks& blocks(int64_t handle) { return find<UserBlocks>(handle, "user's block"); }

  // Fixes pattern and places; does nothing the second time.
  void freeze();
  const BlockPattern& pattern() const { return pattern_; }
  int64_t system_size() const { return system_size_; }
  int64_t state_size() const { return variables_.numbers(); }

  // Fills system = [values of H | g | working room] and returns the cost of all terms but the user's.
  double linearise(const double* state, const std::vector<UserLinearisation>& user, int threads, double* system);
  // Fills g and the working room alone; for problems of submaps.
  double slope(const double* state, int threads, double* system);
  double cost(const double* state, int threads) const;
  // The most information that any submap has on one number of its estimate.
  double sharpest() const;
  // How x (+) delta is taken; delta over the free variables.
  Retraction& retraction() { return retraction_; }
  // Throws unless every number is finite and every rotation is one.
  void check_state(const double* state) const;

 private:
  template <class Kind_>
  Kind_& find(int64_t handle, const char* name);
  void check_open() const;
  std::vector<int32_t> cut_into_chunks();
  void place_terms(const std::vector<int64_t>& block_of_slot);

  Variables variables_;
  Retraction retraction_;
  std::vector<int32_t> free_variables_;
  std::vector<std::unique_ptr<Term>> terms_;
  bool frozen_ = false;
  BlockPattern pattern_;
  int32_t chunks_ = 0;
  int64_t system_size_ = 0;
  std::vector<Layout::Spill> spills_;
};

}  // namespace teamslam
