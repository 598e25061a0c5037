#include "formats/path/path_changing.h"

#include "formats/path/path_blocks.h"

#include <algorithm>

namespace haptrace {
namespace {

class ChangedPath final : public PathSource {
 public:
  ChangedPath(std::shared_ptr<const PathSource> path, const Similarity& change)
      : path_(std::move(path)), change_(change) {
    facts_ = path_->facts();
    blocks_ = path_->blocks();
    facts_.peak_speed *= change_.scale;
    facts_.bounds = {};
    for (PathBlock& block : blocks_) {
      block.peak_speed *= change_.scale;
      block.bounds = change_.keeps_axes() ? change_.box(block.bounds) : bounds_of(block);
      facts_.bounds.include(block.bounds.min);
      facts_.bounds.include(block.bounds.max);
    }
    validate_size(facts_.name, facts_.bounds);
  }

  [[nodiscard]] Path read(std::uint64_t first, std::uint64_t count) const override {
    Path path = path_->read(first, count);
    change_.apply(path);
    return path;
  }

  [[nodiscard]] std::uint64_t row_at(double time) const override { return path_->row_at(time); }

 private:
  [[nodiscard]] Box bounds_of(const PathBlock& block) const { return read(block.first, block.rows).bounds(); }

  std::shared_ptr<const PathSource> path_;
  Similarity change_;
};

}  // namespace

Similarity similarity_of(const PathChange& change, const PathSource& path) {
  if (change.is_identity()) return {};
  return change.of(path.read(0, 1).position.front(), path.facts().bounds);
}

std::shared_ptr<const PathSource> changed(std::shared_ptr<const PathSource> path, const Similarity& change) {
  if (change.is_identity()) return path;
  return std::make_shared<ChangedPath>(std::move(path), change);
}

}  // namespace haptrace
