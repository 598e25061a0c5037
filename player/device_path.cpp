#include "player/device_path.h"

#include "base/error.h"

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <functional>

namespace haptrace {
namespace {

class FittedPath final : public PathSource {
 public:
  FittedPath(std::shared_ptr<const PathSource> path, const DeviceInfo& device, const Fit& fit)
      : path_(std::move(path)),
        driven_(device.force_axes),
        middle_(0.5 * (device.workspace_min + device.workspace_max)),
        fit_(fit) {
    facts_ = path_->facts();
    facts_.bounds = {moved(facts_.bounds.min), moved(facts_.bounds.max)};
    facts_.peak_speed *= fit_.scale;
    blocks_ = path_->blocks();
    for (PathBlock& block : blocks_) {
      block.bounds = {moved(block.bounds.min), moved(block.bounds.max)};
      block.peak_speed *= fit_.scale;
    }
  }

  [[nodiscard]] Path read(std::uint64_t first, std::uint64_t count) const override {
    Path path = path_->read(first, count);
    for (Vec3& p : path.position) p = moved(p);
    for (Vec3& v : path.velocity)
      for (int axis = 0; axis < 3; ++axis) v[axis] = driven(axis) ? fit_.scale * v[axis] : 0;
    return path;
  }

  [[nodiscard]] std::uint64_t row_at(double time) const override { return path_->row_at(time); }

 private:
  [[nodiscard]] bool driven(int axis) const { return driven_[static_cast<std::size_t>(axis)]; }

  [[nodiscard]] Vec3 moved(const Vec3& p) const {
    Vec3 flat = p;
    for (int axis = 0; axis < 3; ++axis)
      if (!driven(axis)) flat[axis] = middle_[axis];
    return fit_.scale * flat + fit_.offset;
  }

  std::shared_ptr<const PathSource> path_;
  std::array<bool, 3> driven_;
  Vec3 middle_;
  Fit fit_;
};

/// Returns for each axis along which a path leaves the workspace where both lie: "x from 1.0 to 9.0 mm, the workspace
/// from 0.0 to 5.0 mm".
std::string axes_outside(const Box& path, const Box& workspace) {
  std::string text;
  for (int axis = 0; axis < 3; ++axis)
    if (path.min[axis] < workspace.min[axis] || path.max[axis] > workspace.max[axis])
      text += fmt::format("{}{} from {:.1f} to {:.1f} mm, the workspace from {:.1f} to {:.1f} mm",
                          text.empty() ? "" : "; ", "xyz"[axis], 1e3 * path.min[axis], 1e3 * path.max[axis],
                          1e3 * workspace.min[axis], 1e3 * workspace.max[axis]);
  return text;
}

/// Returns the largest distance of a sample outside the workspace [m]. Reads only the blocks that could hold it.
double distance_outside(const PathSource& path, const Box& workspace) {
  std::vector<std::pair<double, const PathBlock*>> order;
  for (const PathBlock& block : path.blocks()) {
    const Vec3 beyond = (workspace.min - block.bounds.min).cwiseMax(block.bounds.max - workspace.max).cwiseMax(0);
    order.emplace_back(beyond.norm(), &block);
  }
  std::sort(order.begin(), order.end(), std::greater());
  double distance = 0;
  for (const auto& [most, block] : order) {
    if (most <= distance) break;
    distance = std::max(distance, distance_outside(path.read(block->first, block->rows), workspace));
  }
  return distance;
}

}  // namespace

Box workspace_of(const DeviceInfo& device) {
  return {device.workspace_min, device.workspace_max};
}

void check_motors(const DeviceInfo& device, const Vec3& direction, const std::string& what) {
  constexpr double kOnAxis = 0.1;  // least part of a direction on an axis that needs a motor there
  for (int axis = 0; axis < 3; ++axis)
    if (std::abs(direction[axis]) > kOnAxis && !device.force_axes[static_cast<std::size_t>(axis)])
      throw input_error(
          fmt::format("{} has no motor along {}, which {} needs: choose another direction, or another device",
                      device.model, "xyz"[axis], what));
}

DevicePath path_for(const DeviceInfo& device, std::shared_ptr<const PathSource> path, bool fit) {
  const Box workspace = workspace_of(device);
  DevicePath played{.source = std::make_shared<FittedPath>(path, device, Fit{}), .fit = {}};
  const double outside = distance_outside(*played.source, workspace);
  if (outside == 0) return played;
  const PathFacts& facts = played.source->facts();
  if (!fit)
    throw input_error(
        fmt::format("{} leaves the workspace of {} by {:.1f} mm ({}); use --fit to move and scale it inside, or "
                    "--offset, --scale and --about to place it",
                    facts.name, device.model, 1e3 * outside, axes_outside(facts.bounds, workspace)));
  played.fit = fit_into(facts.bounds, workspace);
  played.source = std::make_shared<FittedPath>(std::move(path), device, *played.fit);
  return played;
}

}  // namespace haptrace
