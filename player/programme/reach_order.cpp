#include "player/programme/reach_order.h"

#include "base/error.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <numeric>

namespace haptrace {
namespace {

constexpr std::size_t kBeforeProbes = 5;  // reaches before the first clamp or catch trial of a block

/// Draws the targets of one exercise, cycle by cycle.
class TargetCycles {
 public:
  TargetCycles(std::size_t targets, OrderDraw& draw) : cycle_(targets), next_(targets), draw_(draw) {
    std::iota(cycle_.begin(), cycle_.end(), 0);
  }

  int next() {
    if (next_ == cycle_.size()) {
      const int before = cycle_.back();
      do {
        draw_.shuffle(cycle_);
      } while (begun_ && cycle_.size() > 1 && cycle_.front() == before);
      next_ = 0;
      begun_ = true;
    }
    return cycle_[next_++];
  }

 private:
  std::vector<int> cycle_;
  std::size_t next_;
  bool begun_ = false;
  OrderDraw& draw_;
};

/// Returns the kind of each reach of a block.
std::vector<ReachKind> kinds_of(const ReachBlock& block, OrderDraw& draw) {
  const auto all = static_cast<std::size_t>(block.reaches);
  const auto clamps = static_cast<std::size_t>(std::lround(block.clamps * block.reaches)),
             catches = static_cast<std::size_t>(std::lround(block.catches * block.reaches));
  std::vector<ReachKind> kinds(all, ReachKind::plain), probes(clamps, ReachKind::clamp);
  probes.resize(clamps + catches, ReachKind::catch_trial);
  if (probes.empty()) return kinds;
  // Without the plain reach that each but the last one needs behind it, any places will do.
  const std::size_t taken = kBeforeProbes + probes.size() - 1;
  if (all < taken + probes.size())
    throw input_error(fmt::format(
        "reach.blocks: '{}' has no room for {} clamps and {} catch trials among {} reaches: none is among the first "
        "{}, and no two follow each other. Lower their shares, or add reaches",
        block.name, clamps, catches, block.reaches, kBeforeProbes));
  std::vector<std::size_t> places(all - taken);
  std::iota(places.begin(), places.end(), kBeforeProbes);
  draw.shuffle(places);
  places.resize(probes.size());
  std::sort(places.begin(), places.end());
  draw.shuffle(probes);
  for (std::size_t i = 0; i < probes.size(); ++i) kinds[places[i] + i] = probes[i];
  return kinds;
}

}  // namespace

std::vector<PlannedReach> order_of_reaches(const ReachTask& task, OrderDraw& draw) {
  constexpr std::uint64_t kSteps = 1000;
  TargetCycles targets(task.targets.size(), draw);
  std::vector<PlannedReach> reaches;
  for (std::size_t block = 0; block < task.blocks.size(); ++block)
    for (const ReachKind kind : kinds_of(task.blocks[block], draw)) {
      const double share = static_cast<double>(draw.below(kSteps + 1)) / kSteps;
      reaches.push_back({.target = targets.next(),
                         .block = static_cast<int>(block),
                         .kind = kind,
                         .start_hold = std::lerp(task.least_start_hold, task.most_start_hold, share)});
    }
  return reaches;
}

std::vector<SenseTrial> order_of_pairs(const SenseTask& task, OrderDraw& draw) {
  std::vector<SenseTrial> trials;
  for (int pair = 0; pair < static_cast<int>(task.pairs().size()); ++pair)
    trials.insert(trials.end(), static_cast<std::size_t>(task.tries / 2), SenseTrial{.pair = pair});
  draw.shuffle(trials);
  return trials;
}

}  // namespace haptrace
