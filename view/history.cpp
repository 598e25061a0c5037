#include "view/history.h"

#include <algorithm>

namespace haptrace {
namespace {

/// Returns floor(a / b) for b > 0.
std::int64_t floor_div(std::int64_t a, std::int64_t b) noexcept {
  return a / b - (a % b < 0 ? 1 : 0);
}

constexpr int kThinLevel = 3;  // what old blocks keep: a sixteenth of the cells

}  // namespace

void ViewRows::add(std::int64_t time, std::span<const float> values) {
  time_ns.push_back(time);
  for (std::size_t i = 0; i < planes.size(); ++i) planes[i].push_back(values[i]);
}

void ViewRows::add(const ViewRows& from, std::size_t first, std::size_t count) {
  const auto append = [&](auto& to, const auto& source) {
    const auto begin = source.begin() + static_cast<std::ptrdiff_t>(first);
    to.insert(to.end(), begin, begin + static_cast<std::ptrdiff_t>(count));
  };
  append(time_ns, from.time_ns);
  for (std::size_t i = 0; i < planes.size(); ++i) append(planes[i], from.planes[i]);
}

void ViewRows::clear() noexcept {
  time_ns.clear();
  for (std::vector<float>& plane : planes) plane.clear();
}

History::History(std::size_t channels, std::int64_t period_ns, const Bounds& bounds)
    : channels_(channels),
      period_ns_(std::clamp<std::int64_t>(period_ns, 1, 1'000'000'000'000)),
      block_ns_(period_ns_ * PyramidBlock::kRows),
      bounds_(bounds) {}

std::int64_t History::block_of(std::int64_t time_ns) const noexcept {
  return floor_div(time_ns, block_ns_);
}

History::Block& History::block_at(std::int64_t index) {
  const auto [found, fresh] = blocks_.try_emplace(index, channels_);
  if (fresh) cell_bytes_ += found->second.pyramid.bytes();
  return found->second;
}

void History::append(std::int64_t time_ns, std::span<const float> values) {
  if (time_ns <= last_ns_) return;
  const std::int64_t index = block_of(time_ns);
  if (last_ns_ < 0 || index != block_of(last_ns_)) {
    if (last_ns_ >= 0) block_at(block_of(last_ns_)).pyramid.settle();
    (void)block_at(index);
    thin_cells(index);
  }
  last_ns_ = time_ns;
  Block& block = block_at(index);
  if (block.rows.size() == 0) cell_bytes_ -= block.pyramid.bytes();
  block.pyramid.add((time_ns - block_begin(index)) / period_ns_, values);
  if (block.rows.size() == 0) cell_bytes_ += block.pyramid.bytes();
  block.rows.add(time_ns, values);
  block.used = ++uses_;
  row_bytes_ += bytes_per_row();
  if (row_bytes_ > bounds_.rows) forget_rows(index);
}

void History::put(std::int64_t index, ViewRows rows) {
  Block& block = block_at(index);
  row_bytes_ -= bytes_per_row() * block.rows.size();
  cell_bytes_ -= block.pyramid.bytes();
  block.pyramid = PyramidBlock(channels_);
  block.thin = false;
  std::vector<float> values(channels_);
  for (std::size_t row = 0; row < rows.size(); ++row) {
    for (std::size_t channel = 0; channel < channels_; ++channel) values[channel] = rows.planes[channel][row];
    block.pyramid.add((rows.time_ns[row] - block_begin(index)) / period_ns_, values);
  }
  block.pyramid.settle();
  block.kept = true;
  block.rows = std::move(rows);
  block.used = ++uses_;
  row_bytes_ += bytes_per_row() * block.rows.size();
  cell_bytes_ += block.pyramid.bytes();
  forget_rows(index);
  thin_cells(index);
}

bool History::has_cells(std::int64_t block, std::int64_t width) const {
  const auto found = blocks_.find(block);
  return found != blocks_.end() && (!found->second.thin || width >= PyramidBlock::width(kThinLevel));
}

bool History::has_rows(std::int64_t block) const {
  const auto found = blocks_.find(block);
  return found != blocks_.end() && found->second.kept;
}

/// Forgets the rows of the blocks that were not used for longest, except those of `spare`.
void History::forget_rows(std::int64_t spare) {
  while (row_bytes_ > bounds_.rows) {
    auto oldest = blocks_.end();
    for (auto at = blocks_.begin(); at != blocks_.end(); ++at)
      if (at->first != spare && at->second.kept && at->second.rows.size() > 0 &&
          (oldest == blocks_.end() || at->second.used < oldest->second.used))
        oldest = at;
    if (oldest == blocks_.end()) return;
    row_bytes_ -= bytes_per_row() * oldest->second.rows.size();
    oldest->second.rows = ViewRows(channels_);
    oldest->second.kept = false;
  }
}

/// Removes narrow cells of the blocks that were not used for longest, except those of `spare`.
void History::thin_cells(std::int64_t spare) {
  while (cell_bytes_ > bounds_.cells) {
    Block* oldest = nullptr;
    for (auto& [index, block] : blocks_)
      if (index != spare && !block.thin && (oldest == nullptr || block.used < oldest->used)) oldest = &block;
    if (oldest == nullptr) return;
    cell_bytes_ -= oldest->pyramid.bytes();
    oldest->pyramid.thin(kThinLevel);
    oldest->thin = true;
    cell_bytes_ += oldest->pyramid.bytes();
  }
}

std::int64_t History::bin_width(std::int64_t from_ns, std::int64_t to_ns, std::size_t pixels) const noexcept {
  const std::int64_t span = floor_div(to_ns, period_ns_) - floor_div(from_ns, period_ns_);
  std::int64_t width = 1;
  while (span / width > static_cast<std::int64_t>(std::max<std::size_t>(pixels, 1))) width *= 2;
  return width;
}

/// Returns the values of the row periods [from, from + width), from cells. `width` is a power of two, and `from` a
/// multiple of it.
PyramidBin History::cell(std::int64_t from, std::int64_t width, std::size_t channel) const {
  PyramidBin bin;
  int level = 0;
  while (level + 1 < PyramidBlock::kLevels && PyramidBlock::width(level + 1) <= width) ++level;
  const std::int64_t step = PyramidBlock::width(level);
  const std::int64_t end = from + width;
  const std::int64_t last_block = floor_div(end - 1, PyramidBlock::kRows);
  for (auto at = blocks_.lower_bound(floor_div(from, PyramidBlock::kRows));
       at != blocks_.end() && at->first <= last_block; ++at) {
    at->second.used = ++uses_;
    const std::int64_t begin = at->first * PyramidBlock::kRows;
    const std::int64_t first = floor_div(std::max(from, begin) - begin, step);
    const std::int64_t past = std::min(end, begin + PyramidBlock::kRows) - begin;
    for (std::int64_t index = first; index * step < past; ++index)
      bin.add(at->second.pyramid.bin(level, index, channel));
  }
  return bin;
}

void History::add_rows(const Block& block, std::int64_t first_ns, std::int64_t width_ns,
                       std::span<const std::size_t> channels, ViewBins& bins) const {
  const std::vector<std::int64_t>& time = block.rows.time_ns;
  const std::int64_t end_ns = first_ns + width_ns * static_cast<std::int64_t>(bins.count);
  const auto begin = std::lower_bound(time.begin(), time.end(), first_ns);
  const auto end = std::lower_bound(begin, time.end(), end_ns);
  for (std::size_t i = 0; i < channels.size(); ++i) {
    const std::vector<float>& plane = block.rows.planes[channels[i]];
    for (auto at = begin; at != end; ++at)
      bins.channels[i][static_cast<std::size_t>((*at - first_ns) / width_ns)].add(
          plane[static_cast<std::size_t>(at - time.begin())]);
  }
}

ViewBins History::bins(std::int64_t from_ns, std::int64_t to_ns, std::int64_t width,
                       std::span<const std::size_t> channels) {
  if (const auto newest = blocks_.find(block_of(last_ns_)); newest != blocks_.end()) newest->second.pyramid.settle();
  ViewBins result;
  const std::int64_t first = floor_div(floor_div(from_ns, period_ns_), width);
  const std::int64_t last = floor_div(floor_div(std::max(from_ns, to_ns), period_ns_), width);
  result.width_ns = width * period_ns_;
  result.first_ns = first * result.width_ns;
  result.count = static_cast<std::size_t>(last - first + 1);
  result.channels.assign(channels.size(), std::vector<PyramidBin>(result.count));
  if (width >= PyramidBlock::kBase) {
    for (std::size_t i = 0; i < channels.size(); ++i)
      for (std::size_t k = 0; k < result.count; ++k)
        result.channels[i][k] = cell((first + static_cast<std::int64_t>(k)) * width, width, channels[i]);
    return result;
  }
  // Bins are narrower than a cell, and no bin reaches over two blocks.
  const std::int64_t first_block = floor_div(first * width, PyramidBlock::kRows);
  const std::int64_t last_block = floor_div(last * width, PyramidBlock::kRows);
  for (auto at = blocks_.lower_bound(first_block); at != blocks_.end() && at->first <= last_block; ++at) {
    if (at->second.kept) {
      at->second.used = ++uses_;
      add_rows(at->second, result.first_ns, result.width_ns, channels, result);
      continue;
    }
    const std::int64_t begin = std::max(first, at->first * PyramidBlock::kRows / width);
    const std::int64_t end = std::min(last + 1, (at->first + 1) * PyramidBlock::kRows / width);
    for (std::size_t i = 0; i < channels.size(); ++i)
      for (std::int64_t k = begin; k < end; ++k) {
        const std::int64_t in_block = k * width - at->first * PyramidBlock::kRows;
        result.channels[i][static_cast<std::size_t>(k - first)] =
            at->second.pyramid.bin(0, in_block / PyramidBlock::kBase, channels[i]);
      }
  }
  return result;
}

ViewRows History::rows(std::int64_t from_ns, std::int64_t to_ns, std::size_t most, bool& cut) const {
  cut = false;
  ViewRows result(channels_);
  if (to_ns < from_ns) return result;
  for (auto at = blocks_.lower_bound(block_of(from_ns)); at != blocks_.end() && at->first <= block_of(to_ns); ++at) {
    const Block& block = at->second;
    if (!block.kept) {
      cut = true;
      continue;
    }
    block.used = ++uses_;
    const std::vector<std::int64_t>& time = block.rows.time_ns;
    const auto begin = std::lower_bound(time.begin(), time.end(), from_ns);
    const auto end = std::upper_bound(begin, time.end(), to_ns);
    const std::size_t count = std::min(static_cast<std::size_t>(end - begin), most - result.size());
    result.add(block.rows, static_cast<std::size_t>(begin - time.begin()), count);
    if (count < static_cast<std::size_t>(end - begin)) {
      cut = true;
      break;
    }
  }
  return result;
}

}  // namespace haptrace
