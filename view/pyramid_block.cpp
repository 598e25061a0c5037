#include "view/pyramid_block.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace haptrace {
namespace {

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

constexpr std::array<std::size_t, PyramidBlock::kLevels> kCellsBefore{0, 256, 320, 336, 340};  // of lower levels
constexpr std::size_t kCells = 341;

}  // namespace

PyramidBin::PyramidBin() noexcept : cell{kNone, kNone, kNone, kNone} {}

void PyramidBin::add(float value) noexcept {
  if (std::isnan(value)) return;
  if (std::isnan(cell.first)) {
    cell = {value, value, value, value};
    return;
  }
  cell.last = value;
  if (value < cell.min) {
    cell.min = value;
    min_first = false;
  }
  if (value > cell.max) {
    cell.max = value;
    min_first = true;
  }
}

void PyramidBin::add(const PyramidBin& later) noexcept {
  if (std::isnan(later.cell.first)) return;
  if (std::isnan(cell.first)) {
    *this = later;
    return;
  }
  const bool lower = later.cell.min<cell.min, higher = later.cell.max> cell.max;
  if (lower && higher)
    min_first = later.min_first;
  else if (lower || higher)
    min_first = higher;
  if (lower) cell.min = later.cell.min;
  if (higher) cell.max = later.cell.max;
  cell.last = later.cell.last;
}

PyramidBlock::PyramidBlock(std::size_t channels) : channels_(channels) {}

std::size_t PyramidBlock::at(int level, std::int64_t index, std::size_t channel) const noexcept {
  const std::size_t cell = kCellsBefore[static_cast<std::size_t>(level)] -
                           kCellsBefore[static_cast<std::size_t>(floor_)] + static_cast<std::size_t>(index);
  return cell * channels_ + channel;
}

PyramidBin PyramidBlock::stored(const PyramidCell& cell, bool min_first) noexcept {
  PyramidBin bin;
  bin.cell = cell;
  bin.min_first = min_first;
  return bin;
}

void PyramidBlock::store(std::size_t place, const PyramidBin& bin) noexcept {
  cells_[place] = bin.cell;
  min_first_[place] = bin.min_first;
}

void PyramidBlock::add(std::int64_t slot, std::span<const float> values) {
  const std::int64_t base = slot / kBase;
  if (cells_.empty()) {
    cells_.assign(kCells * channels_, PyramidBin().cell);
    min_first_.assign(kCells * channels_, true);
  }
  if (base != open_) {
    settle();
    open_ = base;
  }
  for (std::size_t channel = 0; channel < channels_; ++channel) {
    const std::size_t place = at(0, base, channel);
    PyramidBin bin = load(place);
    bin.add(values[channel]);
    store(place, bin);
  }
}

void PyramidBlock::settle() {
  if (open_ < 0) return;
  for (int level = 1; level < kLevels; ++level) {
    const std::int64_t index = open_ * kBase / width(level);
    for (std::size_t channel = 0; channel < channels_; ++channel) {
      const std::size_t place = at(level, index, channel);
      PyramidBin bin = load(place);
      bin.add(load(at(0, open_, channel)));
      store(place, bin);
    }
  }
}

PyramidBin PyramidBlock::bin(int level, std::int64_t index, std::size_t channel) const noexcept {
  if (cells_.empty()) return {};
  if (level >= floor_) return load(at(level, index, channel));
  return load(at(floor_, index * width(level) / width(floor_), channel));
}

void PyramidBlock::thin(int level) {
  if (level <= floor_ || cells_.empty()) return;
  settle();
  const auto gone = static_cast<std::ptrdiff_t>(at(level, 0, 0));
  cells_.erase(cells_.begin(), cells_.begin() + gone);
  min_first_.erase(min_first_.begin(), min_first_.begin() + gone);
  cells_.shrink_to_fit();
  min_first_.shrink_to_fit();
  floor_ = level;
  open_ = -1;
}

std::size_t PyramidBlock::bytes() const noexcept {
  return cells_.capacity() * sizeof(PyramidCell) + min_first_.capacity() / 8;
}

}  // namespace haptrace
