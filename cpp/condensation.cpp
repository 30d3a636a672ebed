#include "condensation.hpp"

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <span>
#include <utility>

#include "threads.hpp"

namespace teamslam {

// The blocks of every variable with others, and with itself first.
struct Condensation::Whole {
  struct Link {
    int32_t other;
    int64_t block;
  };
  const BlockPattern& pattern;
  const double* values;
  std::vector<int64_t> start;
  std::vector<Link> link;

  Whole(const BlockPattern& pattern_, const double* values_) : pattern(pattern_), values(values_) {
    const int32_t n = pattern.variables();
    start.assign(static_cast<size_t>(n) + 1, 0);
    each_block([&](int32_t r, int32_t c, int64_t) { ++start[c + 1], r == c ? 0 : ++start[r + 1]; });
    std::partial_sum(start.begin(), start.end(), start.begin());
    link.resize(static_cast<size_t>(start.back()));
    std::vector<int64_t> next(start.begin(), start.end() - 1);
    each_block([&](int32_t r, int32_t c, int64_t k) {
      link[next[c]++] = {r, k};
      if (r != c) link[next[r]++] = {c, k};
    });
  }

  std::span<const Link> links(int32_t v) const { return {link.data() + start[v], link.data() + start[v + 1]}; }
  int64_t dof(int32_t v) const { return pattern.dof[v]; }

  template <class Visit>
  void each_block(const Visit& visit) const {
    for (int32_t c = 0; c < pattern.variables(); ++c)
      for (int64_t k = pattern.column_start[c]; k < pattern.column_start[c + 1]; ++k) visit(pattern.row[k], c, k);
  }

  int64_t unknowns(const std::vector<int32_t>& variables) const {
    int64_t sum = 0;
    for (int32_t v : variables) sum += dof(v);
    return sum;
  }

  // The rows of a block, column-major, with `row` as its row variable.
  void copy(int64_t k, int32_t row, int32_t column, double* out) const {
    const double* from = values + pattern.value_start[k];
    const int64_t height = dof(row), width = dof(column);
    const bool transposed = pattern.row[k] != row;
    for (int64_t j = 0; j < width; ++j)
      for (int64_t i = 0; i < height; ++i) out[i + height * j] = transposed ? from[j + width * i] : from[i + height * j];
  }
};

Condensation::Condensation(const BlockPattern& pattern, const double* values, std::vector<uint8_t> gone, bool frugal,
                           int threads)
    : gone_(std::move(gone)), threads_(threads), dof_(pattern.dof) {
  const Whole whole(pattern, values);
  groups_ = groups_of(whole);
  lay_out(whole);
  if (frugal && pattern_.size() > pattern.size()) keep_what_pays(whole);
  std::stable_sort(groups_.begin(), groups_.end(),
                   [](const Group& a, const Group& b) { return a.inner.size() > b.inner.size(); });
  share_out(static_cast<int64_t>(groups_.size()), threads_, [&](int64_t g) { eliminate(whole, groups_[g]); });
  for (const Group& group : groups_)
    if (group.failed >= 0 && (failed_ < 0 || group.failed < failed_)) failed_ = group.failed;
  if (failed_ < 0) add_up(whole);
}

// Variables that go and hang together, with what they touch.
std::vector<Condensation::Group> Condensation::groups_of(const Whole& whole) const {
  std::vector<Group> groups;
  std::vector<int32_t> seen(gone_.size(), -1);
  for (int32_t first = 0; first < static_cast<int32_t>(gone_.size()); ++first) {
    if (!gone_[first] || seen[first] >= 0) continue;
    const auto number = static_cast<int32_t>(groups.size());
    Group& group = groups.emplace_back();
    group.inner.push_back(first);
    seen[first] = number;
    for (size_t at = 0; at < group.inner.size(); ++at) {
      for (const auto& link : whole.links(group.inner[at])) {
        if (seen[link.other] == number) continue;
        seen[link.other] = number;
        (gone_[link.other] ? group.inner : group.border).push_back(link.other);
      }
    }
    std::sort(group.inner.begin(), group.inner.end());
    std::sort(group.border.begin(), group.border.end());
  }
  return groups;
}

void Condensation::keep_what_pays(const Whole& whole) {
  std::erase_if(groups_, [&](const Group& group) {
    const int64_t border = whole.unknowns(group.border);
    int64_t goes = 0;
    for (int32_t v : group.inner)
      for (const auto& link : whole.links(v)) {
        const int64_t numbers = whole.dof(v) * whole.dof(link.other);
        goes += link.other == v ? (numbers + whole.dof(v)) / 2 : gone_[link.other] && link.other < v ? 0 : numbers;
      }
    return border * (border + 1) / 2 > goes;
  });
  std::fill(gone_.begin(), gone_.end(), uint8_t{0});
  for (const Group& group : groups_)
    for (int32_t v : group.inner) gone_[v] = 1;
  lay_out(whole);
}

// The pattern of what stays: the blocks that it had, and one for each two variables of one border.
void Condensation::lay_out(const Whole& whole) {
  const auto n = static_cast<int32_t>(gone_.size());
  place_.assign(gone_.size(), 0);
  scalar_start_.assign(gone_.size(), 0);
  pattern_ = {};
  pattern_.scalar_start.push_back(0);
  scalars_gone_ = 0;
  std::vector<int32_t> stays;
  for (int32_t v = 0; v < n; ++v) {
    scalar_start_[v] = gone_[v] ? scalars_gone_ : pattern_.scalars();
    if (gone_[v]) {
      scalars_gone_ += dof_[v];
      continue;
    }
    place_[v] = static_cast<int32_t>(stays.size());
    stays.push_back(v);
    pattern_.dof.push_back(dof_[v]);
    pattern_.scalar_start.push_back(pattern_.scalars() + dof_[v]);
  }
  std::vector<std::vector<int32_t>> borders(stays.size());  // the groups in whose border each variable is
  for (size_t g = 0; g < groups_.size(); ++g)
    for (int32_t v : groups_[g].border) borders[place_[v]].push_back(static_cast<int32_t>(g));
  pattern_.column_start.push_back(0);
  pattern_.value_start.push_back(0);
  std::vector<int32_t> seen(stays.size(), -1);
  for (int32_t c = 0; c < static_cast<int32_t>(stays.size()); ++c) {
    const auto begin = static_cast<std::ptrdiff_t>(pattern_.row.size());
    const auto take = [&](int32_t v) {
      const int32_t r = place_[v];
      if (r < c || seen[r] == c) return;
      seen[r] = c;
      pattern_.row.push_back(r);
    };
    for (const auto& link : whole.links(stays[c]))
      if (!gone_[link.other]) take(link.other);
    for (int32_t g : borders[c])
      for (int32_t v : groups_[g].border) take(v);
    std::sort(pattern_.row.begin() + begin, pattern_.row.end());
    pattern_.column_start.push_back(static_cast<int64_t>(pattern_.row.size()));
    for (auto r = pattern_.row.begin() + begin; r != pattern_.row.end(); ++r)
      pattern_.value_start.push_back(pattern_.value_start.back() + int64_t{pattern_.dof[*r]} * pattern_.dof[c]);
  }
}

void Condensation::eliminate(const Whole& whole, Group& group) const {
  const auto inner = static_cast<int32_t>(group.inner.size());
  BlockPattern own;
  std::vector<double> values;
  own.scalar_start.push_back(0), own.column_start.push_back(0), own.value_start.push_back(0);
  for (const auto* variables : {&group.inner, &group.border})
    for (int32_t v : *variables) {
      own.dof.push_back(dof_[v]);
      own.scalar_start.push_back(own.scalars() + dof_[v]);
    }
  const auto local = [&](int32_t v) {
    const auto& among = gone_[v] ? group.inner : group.border;
    const auto at = std::lower_bound(among.begin(), among.end(), v) - among.begin();
    return static_cast<int32_t>(at) + (gone_[v] ? 0 : inner);
  };
  const auto append = [&](int32_t row, int32_t column) {
    own.row.push_back(row);
    own.value_start.push_back(own.value_start.back() + int64_t{own.dof[row]} * own.dof[column]);
    values.resize(static_cast<size_t>(own.value_start.back()), 0.0);
  };
  std::vector<std::pair<int32_t, int64_t>> rows;
  for (int32_t c = 0; c < inner; ++c) {
    rows.clear();
    for (const auto& link : whole.links(group.inner[c]))
      if (const int32_t r = local(link.other); r >= c) rows.emplace_back(r, link.block);
    std::sort(rows.begin(), rows.end());
    for (const auto& [r, block] : rows) {
      append(r, c);
      const int32_t row = r < inner ? group.inner[r] : group.border[r - inner];
      whole.copy(block, row, group.inner[c], values.data() + own.value_start[own.value_start.size() - 2]);
    }
    own.column_start.push_back(own.blocks());
  }
  std::vector<int32_t> last;
  for (int32_t c = inner; c < own.variables(); ++c) {
    append(c, c);
    own.column_start.push_back(own.blocks());
    last.push_back(c);
  }
  const auto border = static_cast<int32_t>(last.size());
  Cholesky& factor = group.factor.emplace_back(analysed(own, Ordering::automatic, nullptr, last.data(), border, 1), 1);
  group.complement.resize(static_cast<size_t>(factor.last_scalars() * factor.last_scalars()));
  const int32_t stopped = factor.eliminate(values.data(), nullptr, group.complement.data(), nullptr, nullptr);
  if (stopped >= 0) group.failed = group.inner[stopped];
  factor.put_away();
}

// Group after group, so that the bits do not depend on who eliminated which.
void Condensation::add_up(const Whole& whole) {
  values_.assign(static_cast<size_t>(pattern_.size()), 0.0);
  whole.each_block([&](int32_t r, int32_t c, int64_t k) {
    if (!gone_[r] && !gone_[c]) whole.copy(k, r, c, block(place_[r], place_[c]));
  });
  for (Group& group : groups_) {
    const auto m = static_cast<int64_t>(whole.unknowns(group.border));
    int64_t across = 0;
    for (size_t j = 0; j < group.border.size(); ++j) {
      const int32_t c = place_[group.border[j]];
      const int64_t width = pattern_.dof[c];
      int64_t k = pattern_.column_start[c], down = across;
      for (size_t i = j; i < group.border.size(); ++i) {
        const int32_t r = place_[group.border[i]];
        while (pattern_.row[k] != r) ++k;
        double* to = values_.data() + pattern_.value_start[k];
        const int64_t height = pattern_.dof[r];
        for (int64_t q = 0; q < width; ++q)
          for (int64_t p = 0; p < height; ++p) to[p + height * q] += group.complement[down + p + m * (across + q)];
        down += height;
      }
      across += width;
    }
    group.complement = {};
  }
}

double* Condensation::block(int32_t row, int32_t column) {
  const auto begin = pattern_.row.begin() + pattern_.column_start[column];
  const auto end = pattern_.row.begin() + pattern_.column_start[column + 1];
  return values_.data() + pattern_.value_start[std::lower_bound(begin, end, row) - pattern_.row.begin()];
}

void Condensation::follow(const double* stays, double* gone) const {
  std::fill_n(gone, scalars_gone_, 0.0);
  share_out(static_cast<int64_t>(groups_.size()), threads_, [&](int64_t g) {
    const Group& group = groups_[g];
    if (group.border.empty()) return;
    std::vector<double> border, x;
    for (int32_t v : group.border)
      border.insert(border.end(), stays + scalar_start_[v], stays + scalar_start_[v] + dof_[v]);
    int64_t inner = 0;
    for (int32_t v : group.inner) inner += dof_[v];
    x.assign(static_cast<size_t>(inner) + border.size(), 0.0);
    group.factor.front().back_substitute(border.data(), x.data());
    const double* next = x.data();
    for (int32_t v : group.inner) {
      std::copy_n(next, dof_[v], gone + scalar_start_[v]);
      next += dof_[v];
    }
  });
}

}  // namespace teamslam
