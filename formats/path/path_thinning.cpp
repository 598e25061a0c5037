#include "formats/path/path_thinning.h"

#include "base/error.h"
#include "formats/path/path_blocks.h"

#include <algorithm>
#include <fmt/format.h>

namespace haptrace {
namespace {

class ThinnedPath final : public PathSource {
 public:
  ThinnedPath(std::shared_ptr<const PathSource> path, std::uint64_t every) : path_(std::move(path)), every_(every) {
    const PathFacts& facts = path_->facts();
    facts_ = {.name = facts.name,
              .begin = facts.begin,
              .end = facts.end,
              .velocity = facts.velocity,
              .force = facts.force,
              .orientation = facts.orientation,
              .contacts = facts.contacts,
              .notes = facts.notes};
    PathBlocks blocks;
    const std::uint64_t rows = whole_steps() + 1 + (last_is_extra() ? 1 : 0);
    for (std::uint64_t row = 0; row < rows; row += PathBlocks::kRows) {
      const Path part = pick(row, std::min(PathBlocks::kRows, rows - row));
      for (std::size_t i = 0; i < part.size(); ++i) blocks.add(part.time[i], part.position[i]);
    }
    blocks_ = blocks.blocks();
    for (const PathBlock& block : blocks_) join_block(facts_, block);
  }

  [[nodiscard]] Path read(std::uint64_t first, std::uint64_t count) const override {
    first = std::min(first, facts_.rows - 1);
    return pick(first, std::min(count, facts_.rows - first));
  }

  [[nodiscard]] std::uint64_t row_at(double time) const override {
    const std::uint64_t row = path_->row_at(time);
    return last_is_extra() && row == path_->facts().rows - 1 ? facts_.rows - 1 : row / every_;
  }

 private:
  /// Reads in stretches, to bound the number of skipped rows in memory.
  [[nodiscard]] Path pick(std::uint64_t first, std::uint64_t count) const {
    constexpr std::uint64_t kStretch = 65'536;
    Path result{.name = facts_.name};
    for (std::uint64_t row = first; row < first + count;) {
      const std::uint64_t from = original(row);
      std::uint64_t end = row + 1;
      while (end < first + count && original(end) - from < kStretch) ++end;
      const Path stretch = path_->read(from, original(end - 1) - from + 1);
      for (; row < end; ++row) take(stretch, static_cast<std::size_t>(original(row) - from), result);
    }
    return result;
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
        fmt::format("cannot keep every {}th sample of a path; the number must be 1 to {}", every, kMostThinning));
  if (every == 1) return path;
  return std::make_shared<ThinnedPath>(std::move(path), static_cast<std::uint64_t>(every));
}

}  // namespace haptrace
