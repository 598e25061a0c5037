#include "control/walked_set.h"

#include <algorithm>

namespace haptrace {

double WalkedSet::add(double a, double b) noexcept {
  const double from = std::min(a, b), to = std::max(a, b);
  Interval joined{from, to};
  double fresh = to - from;
  std::size_t first = 0;
  while (first < count_ && intervals_[first].to < from) ++first;
  std::size_t last = first;
  for (; last < count_ && intervals_[last].from <= to; ++last) {
    const Interval& old = intervals_[last];
    fresh -= std::max(std::min(old.to, to) - std::max(old.from, from), 0.0);
    joined = {std::min(joined.from, old.from), std::max(joined.to, old.to)};
  }
  const auto begin = intervals_.begin(), end = begin + static_cast<std::ptrdiff_t>(count_);
  const auto at = begin + static_cast<std::ptrdiff_t>(first), after = begin + static_cast<std::ptrdiff_t>(last);
  if (first == last) {
    std::move_backward(at, end, end + 1);
    ++count_;
  } else {
    std::move(after, end, at + 1);
    count_ -= last - first - 1;
  }
  *at = joined;
  if (count_ > kMost) join_closest();
  return std::max(fresh, 0.0);
}

void WalkedSet::join_closest() noexcept {
  const auto gap = [this](std::size_t i) { return intervals_[i + 1].from - intervals_[i].to; };
  std::size_t closest = 0;
  for (std::size_t i = 1; i + 1 < count_; ++i)
    if (gap(i) < gap(closest)) closest = i;
  intervals_[closest].to = intervals_[closest + 1].to;
  const auto next = intervals_.begin() + static_cast<std::ptrdiff_t>(closest) + 1;
  std::move(next + 1, intervals_.begin() + static_cast<std::ptrdiff_t>(count_), next);
  --count_;
}

}  // namespace haptrace
