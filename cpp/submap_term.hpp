// A submap as one measurement of many variables: joining, equations (11)-(14) of the paper.
//
// A base variable b is the submap's frame (none: the frame is the world's). Member v has a local estimate s_v, in that
// frame, and
//   e_v = s_v (-) (X_b^-1 X_v),   cost = e'Ie + 2 eta'e,
// with I the submap's information and eta its linear term (zero, unless the estimate is not its own optimum). With
// A = -de/dG, the term adds A'IA to H and A'(Ie + eta) to g. I is block-sparse and stays so: E = I A_b is formed once,
//   H_vw += A_v' I_vw A_w,   H_vb += A_v' E_v,   H_bb += sum_v A_bv' E_v.
// An estimate may be a pose in space where the variable is planar: the variable is lifted. It may be a point where the
// variable is a pose: it is of the pose's place, and says nothing of its rotation.
#pragma once

#include <cstdint>
#include <vector>

#include "block_matrix.hpp"
#include "term.hpp"
#include "variables.hpp"

namespace teamslam {

struct SubmapInput {
  int64_t base;  // variable, or -1
  int64_t members;
  const int64_t* member;      // variables
  const int32_t* kind;        // of each local estimate
  const double* state;        // local estimates, one after another
  const double* eta;          // or null: zero
  BlockPattern pattern;       // of I, over the estimates' unknowns
  std::vector<double> values;  // of I
};

class SubmapTerm final : public Term {
 public:
  // Checks the input and takes it over; throws std::invalid_argument.
  SubmapTerm(const Variables& variables, SubmapInput input);

  // New numbers on the same structure.
  void set(const double* state, const double* values, const double* eta);

  void weigh(std::vector<double>& work) const override;
  void arrange(const std::vector<int32_t>& chunk_of_variable, int32_t chunks) override;
  void couple(Couplings& couplings) override;
  void place(int32_t chunk, Layout& layout) override;
  double linearise(int32_t chunk, const double* state, double* system) const override;
  double slope(int32_t chunk, const double* state, double* system) const override;
  double cost(int32_t chunk, const double* state) const override;
  double sharpest() const override;
  int64_t fault(const double* state) const override;

 private:
  struct Member {
    int32_t variable;
    Kind kind;             // of the local estimate
    int64_t state;         // where the estimate begins
    int64_t diagonal, gradient;
    int64_t base_slot, base_block;  // its block with the base; ~start if the member comes first (as in models.hpp)
  };
  struct Work;
  int32_t owner() const;
  int32_t free_of(const Member& member) const { return variables_.free[member.variable]; }
  void check_members(const SubmapInput& input) const;
  void check_pattern() const;
  void check_numbers(const double* state, const double* values, const double* eta) const;
  enum class Wanted { cost, slope, all };
  double evaluate(const double* state, Wanted wanted, Work& work) const;
  void add_gradient(const Work& work, double* system) const;
  void add_members(const Work& work, double* system) const;
  void subtract_bends(const double* state, const Work& work, double* system) const;
  template <int d_b>
  void add_base(const Work& work, double* system) const;

  const Variables& variables_;
  int32_t base_;
  std::vector<Member> members_;
  BlockPattern pattern_;
  std::vector<double> state_, values_, eta_;
  int32_t chunk_ = 0;
  int64_t base_diagonal_ = 0, base_gradient_ = 0;
  std::vector<int64_t> slots_;   // of the stored off-diagonal blocks, in order
  std::vector<int64_t> blocks_;  // where each stored block goes; ~start if transposed
};

}  // namespace teamslam
