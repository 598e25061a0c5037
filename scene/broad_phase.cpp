#include "scene/broad_phase.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

namespace haptrace {
namespace {

constexpr std::size_t kFew = 24;           // boxes for which a grid gains nothing
constexpr double kMostCellsOfABox = 64;    // a box in more cells is compared one by one
constexpr double kMostCellsOfAQuery = 64;  // a query of more cells compares every box
constexpr double kFarthestCell = 1e15;

bool meet(const Box& a, const Box& b) noexcept {
  return a.min.x() <= b.max.x() && a.max.x() >= b.min.x() && a.min.y() <= b.max.y() && a.max.y() >= b.min.y() &&
         a.min.z() <= b.max.z() && a.max.z() >= b.min.z();
}

std::size_t hash_of(std::int64_t x, std::int64_t y, std::int64_t z) noexcept {
  const auto mixed = static_cast<std::uint64_t>(x) * 73856093U ^ static_cast<std::uint64_t>(y) * 19349663U ^
                     static_cast<std::uint64_t>(z) * 83492791U;
  return static_cast<std::size_t>(mixed ^ (mixed >> 29));
}

/// The cells that a box is in.
struct CellRange {
  CellRange(const Box& box, double side)
      : first((box.min / side).array().floor()), last((box.max / side).array().floor()) {}
  [[nodiscard]] double count() const { return (last - first + Vec3::Ones()).prod(); }
  [[nodiscard]] bool usable(double most) const {
    return first.cwiseAbs().maxCoeff() < kFarthestCell && last.cwiseAbs().maxCoeff() < kFarthestCell && count() <= most;
  }
  template <class Visit>
  void each(const Visit& visit) const {
    for (auto x = static_cast<std::int64_t>(first.x()); x <= static_cast<std::int64_t>(last.x()); ++x)
      for (auto y = static_cast<std::int64_t>(first.y()); y <= static_cast<std::int64_t>(last.y()); ++y)
        for (auto z = static_cast<std::int64_t>(first.z()); z <= static_cast<std::int64_t>(last.z()); ++z)
          visit(x, y, z);
  }
  Vec3 first, last;
};

}  // namespace

BroadPhase::BroadPhase(std::vector<Box> boxes)
    : boxes_(std::move(boxes)), found_(boxes_.size()), stamp_(boxes_.size(), 0) {
  if (boxes_.size() > kFew)
    build_grid();
  else
    for (std::uint32_t i = 0; i < boxes_.size(); ++i) large_.push_back(i);
}

void BroadPhase::build_grid() {
  // Twice the median size: then half of the boxes are in at most eight cells, and a query rarely in more than one.
  std::vector<double> sizes;
  for (const Box& box : boxes_)
    if (const double size = box.size().maxCoeff(); std::isfinite(size) && size > 0) sizes.push_back(size);
  if (!sizes.empty()) {
    const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
    std::nth_element(sizes.begin(), middle, sizes.end());
    side_ = 2 * *middle;
  }
  std::map<std::tuple<std::int64_t, std::int64_t, std::int64_t>, std::vector<std::uint32_t>> grid;
  for (std::uint32_t i = 0; i < boxes_.size(); ++i) {
    if (side_ > 0 && is_finite(boxes_[i].min) && is_finite(boxes_[i].max)) {
      const CellRange cells(boxes_[i], side_);
      if (cells.usable(kMostCellsOfABox)) {
        cells.each([&](auto x, auto y, auto z) { grid[{x, y, z}].push_back(i); });
        continue;
      }
    }
    large_.push_back(i);
  }
  if (grid.empty()) return;
  std::size_t slots = 1;
  while (slots < 2 * grid.size()) slots *= 2;
  cells_.resize(slots);
  for (const auto& [key, members] : grid) {
    const auto [x, y, z] = key;
    std::size_t slot = hash_of(x, y, z) & (slots - 1);
    while (cells_[slot].count > 0) slot = (slot + 1) & (slots - 1);
    cells_[slot] = {x, y, z, static_cast<std::uint32_t>(members_.size()), static_cast<std::uint32_t>(members.size())};
    members_.insert(members_.end(), members.begin(), members.end());
  }
}

const BroadPhase::Cell* BroadPhase::find(std::int64_t x, std::int64_t y, std::int64_t z) const noexcept {
  const std::size_t mask = cells_.size() - 1;
  for (std::size_t slot = hash_of(x, y, z) & mask; cells_[slot].count > 0; slot = (slot + 1) & mask)
    if (const Cell& cell = cells_[slot]; cell.x == x && cell.y == y && cell.z == z) return &cell;
  return nullptr;
}

void BroadPhase::take(std::uint32_t box) noexcept {
  if (stamp_[box] == query_) return;
  stamp_[box] = query_;
  found_[count_++] = box;
}

void BroadPhase::consider(std::uint32_t box, const Box& space) noexcept {
  if (meet(boxes_[box], space)) take(box);
}

std::span<const std::uint32_t> BroadPhase::near(const Box& space, std::span<const std::uint32_t> also) noexcept {
  count_ = 0;
  if (++query_ == 0) {  // the numbers begin again
    std::fill(stamp_.begin(), stamp_.end(), 0);
    query_ = 1;
  }
  for (const std::uint32_t box : also) take(box);
  for (const std::uint32_t box : large_) consider(box, space);
  if (!cells_.empty()) {
    const CellRange cells(space, side_);
    if (cells.usable(kMostCellsOfAQuery)) {
      cells.each([&](auto x, auto y, auto z) {
        const Cell* const cell = find(x, y, z);
        if (cell == nullptr) return;
        for (std::uint32_t i = 0; i < cell->count; ++i) consider(members_[cell->first + i], space);
      });
    } else {
      for (std::uint32_t i = 0; i < boxes_.size(); ++i) consider(i, space);
    }
  }
  std::sort(found_.begin(), found_.begin() + static_cast<std::ptrdiff_t>(count_));
  return {found_.data(), count_};
}

}  // namespace haptrace
