#include "formats/path_thinning.h"

#include "control/error.h"

#include <algorithm>
#include <fmt/format.h>

namespace haptrace {
namespace {

class ThinnedPath final : public PathSource {
 public:
  ThinnedPath(std::shared_ptr<const PathSource> path, std::uint64_t every) : path_(std::move(path)), every_(every) {
    facts_ = path_->facts();
    facts_.rows = whole_steps() + 1 + (last_is_extra() ? 1 : 0);
    facts_.longest_interval = std::min(facts_.longest_interval * static_cast<double>(every), facts_.duration());
    for (const PathBlock& block : path_->blocks()) {
      // Rows that stay and lie in the block; the one after it belongs to the last of its intervals.
      const std::uint64_t first = (block.first + every_ - 1) / every_;
      const std::uint64_t end = std::min((block.first + block.rows + every_ - 1) / every_, facts_.rows);
      if (end <= first) {
        if (!blocks_.empty()) join(blocks_.back(), block);
        continue;
      }
      blocks_.push_back(block);
      blocks_.back().first = first;
      blocks_.back().rows = end - first;
      blocks_.back().longest_interval = facts_.longest_interval;
    }
    blocks_.back().rows = facts_.rows - blocks_.back().first;
  }

  [[nodiscard]] Path read(std::uint64_t first, std::uint64_t count) const override {
    first = std::min(first, facts_.rows - 1);
    count = std::min(count, facts_.rows - first);
    Path result{.name = facts_.name};
    // In stretches, so that a path of any length is never in memory at once.
    constexpr std::uint64_t kStretch = 65'536;
    std::uint64_t row = first;
    while (row < first + count) {
      const std::uint64_t from = original(row);
      std::uint64_t end = row + 1;
      while (end < first + count && original(end) - from < kStretch) ++end;
      const Path stretch = path_->read(from, original(end - 1) - from + 1);
      for (; row < end; ++row) take(stretch, static_cast<std::size_t>(original(row) - from), result);
    }
    return result;
  }

  [[nodiscard]] std::uint64_t row_at(double time) const override {
    const std::uint64_t row = path_->row_at(time);
    return last_is_extra() && row == path_->facts().rows - 1 ? facts_.rows - 1 : row / every_;
  }

 private:
  static void join(PathBlock& into, const PathBlock& block) {
    into.bounds.include(block.bounds.min);
    into.bounds.include(block.bounds.max);
    into.peak_speed = std::max(into.peak_speed, block.peak_speed);
  }

  static void take(const Path& from, std::size_t row, Path& into) {
    into.time.push_back(from.time[row]);
    into.position.push_back(from.position[row]);
    if (!from.velocity.empty()) into.velocity.push_back(from.velocity[row]);
    if (!from.force.empty()) into.force.push_back(from.force[row]);
    if (!from.orientation.empty()) into.orientation.push_back(from.orientation[row]);
  }

  [[nodiscard]] std::uint64_t whole_steps() const { return (path_->facts().rows - 1) / every_; }
  [[nodiscard]] bool last_is_extra() const { return (path_->facts().rows - 1) % every_ != 0; }
  [[nodiscard]] std::uint64_t original(std::uint64_t row) const {
    return std::min(row * every_, path_->facts().rows - 1);
  }

  std::shared_ptr<const PathSource> path_;
  std::uint64_t every_;
};

}  // namespace

std::shared_ptr<const PathSource> thinned(std::shared_ptr<const PathSource> path, int every) {
  if (every < 1 || every > kMostThinning)
    throw input_error(
        fmt::format("every {}th sample of a path cannot be kept; it must be 1 to {}", every, kMostThinning));
  if (every == 1) return path;
  return std::make_shared<ThinnedPath>(std::move(path), static_cast<std::uint64_t>(every));
}

}  // namespace haptrace
