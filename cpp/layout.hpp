// Where each measurement adds its part of H and g, fixed once, so that chunks of measurements may run at the same time.
//
// The linear system is one array: [values of H | g | spill]. The work is cut into chunks, a cut that depends on the
// problem alone. A block that one chunk touches lies in H itself. Where several chunks touch a block, the first of them
// owns it, and each other one has a private copy in the spill, added at the end in the order of the chunks. Hence the
// same bits for any number of threads, no locks, and little memory: chunks are runs of consecutive observers, so what
// they share is the landmarks and the seams.
#pragma once

#include <cstdint>
#include <vector>

#include "block_matrix.hpp"
#include "variables.hpp"

namespace teamslam {

class Layout {
 public:
  Layout(const BlockPattern& pattern, const std::vector<int64_t>& block_of_slot);

  // All chunks first claim, in order, then are placed, in order, by the same calls. Only the places count.
  void claim(int32_t chunk);
  void place(int32_t chunk);

  // Where the diagonal block of a free variable begins, its part of g, the block of a slot; a sink if held.
  int64_t diagonal(int32_t free) { return free == held ? sink_ : block(pattern_.column_start[free]); }
  int64_t gradient(int32_t free) {
    if (free == held) return sink_;
    if (mine(pattern_.column_start[free])) return pattern_.size() + pattern_.scalar_start[free];
    return gradient_copy(free);
  }
  int64_t coupling(int64_t slot) { return slot == held ? sink_ : block(block_of_slot_[slot]); }

  struct Spill {
    int64_t target, source, length;
  };
  const std::vector<Spill>& spills() const { return spills_; }  // to be added in this order
  int64_t size() const { return size_; }                        // of the whole array

 private:
  static constexpr int32_t nobody = -1;

  bool mine(int64_t block) {
    if (owner_[block] == nobody) owner_[block] = chunk_;
    return !placing_ || owner_[block] == chunk_;
  }
  int64_t block(int64_t block) { return mine(block) ? pattern_.value_start[block] : block_copy(block); }
  int64_t block_copy(int64_t block);
  int64_t gradient_copy(int32_t free);
  int64_t spill(int64_t target, int64_t length);

  const BlockPattern& pattern_;
  const std::vector<int64_t>& block_of_slot_;
  std::vector<int32_t> owner_;                        // chunk of each block; a gradient goes with its diagonal block
  std::vector<int64_t> block_copy_, gradient_copy_;   // this chunk's copies in the spill, or -1
  std::vector<int64_t> copied_blocks_;                // to forget them at the next chunk
  std::vector<int32_t> copied_gradients_;
  std::vector<Spill> spills_;
  int32_t chunk_ = 0;
  bool placing_ = false;
  int64_t sink_ = 0, size_ = 0;
};

}  // namespace teamslam
