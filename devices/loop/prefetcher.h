// Read-ahead of blocks of a long sequence, in a loader thread, for a servo loop that steps through them.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace haptrace {

/// Provides blocks 0 to count - 1 in order and wraps to block 0 as often as needed. Block 0, the block in use and the
/// next `ahead` blocks are in memory; the first blocks follow the last one.
///
/// Threads: get, failed and wait from one thread. Real-time: get and failed are wait-free and neither allocate nor free
/// memory. The loader thread frees the blocks that are no longer needed.
template <class Block>
class Prefetcher {
 public:
  /// Makes a block, in the loader thread. After an exception, the loader makes no more blocks.
  using Load = std::function<std::unique_ptr<const Block>(std::size_t index)>;

  Prefetcher(std::shared_ptr<const Block> first, std::size_t count, std::size_t ahead, Load load)
      : first_(std::move(first)),
        count_(count),
        window_(std::min(ahead + 1, count)),
        load_(std::move(load)),
        slots_(window_) {
    if (count_ > 1) thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
  }

  ~Prefetcher() {
    if (thread_.joinable()) {
      thread_.request_stop();
      thread_.join();
    }
    for (const Slot& slot : slots_) delete slot.block.load();
  }
  Prefetcher(const Prefetcher&) = delete;
  Prefetcher& operator=(const Prefetcher&) = delete;

  /// Returns block `index`, or null if it is not loaded yet, and asks for this block and the next ones. The block stays
  /// valid until the next call that does not return null.
  [[nodiscard]] const Block* get(std::size_t index) noexcept {
    wanted_.store(index);
    if (index == 0) return first_.get();
    const auto slot = std::find_if(slots_.begin(), slots_.end(), [&](const Slot& s) { return s.index == index; });
    if (slot == slots_.end()) return nullptr;
    // Announce the block before using it: the loader frees no announced block. The previous block stays announced until
    // this one is available.
    const Block* block = slot->block.load();
    std::atomic<const Block*>& in_use = in_use_[1 - used_];
    in_use.store(block);
    if (block == nullptr || slot->block.load() != block || slot->index != index) {
      in_use.store(nullptr);
      return nullptr;
    }
    used_ = 1 - used_;
    return block;
  }

  /// Returns block `index`, one of the `ahead` blocks after the last get, or null if it is not loaded. Valid until the
  /// next get.
  [[nodiscard]] const Block* peek(std::size_t index) const noexcept {
    if (index == 0) return first_.get();
    const auto slot = std::find_if(slots_.begin(), slots_.end(), [&](const Slot& s) { return s.index == index; });
    return slot == slots_.end() ? nullptr : slot->block.load();
  }

  /// Returns true if block `index` will not come, because this block or an earlier one could not be made. error() gives
  /// the reason.
  [[nodiscard]] bool failed(std::size_t index) const noexcept { return broken_ && !there(index); }
  [[nodiscard]] const std::string& error() const noexcept { return error_; }

  /// Waits until block `index`, one of the `ahead` blocks after the last get, is loaded or failed. Not for the tick.
  void wait(std::size_t index) {
    if (there(index) || !in_window(index, wanted_)) return;
    std::unique_lock lock(mutex_);
    nudged_ = true;
    changed_.notify_all();
    changed_.wait(lock, [&] { return there(index) || broken_; });
  }

  [[nodiscard]] std::size_t ahead() const noexcept { return window_ - 1; }

 private:
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);
  static constexpr auto kPoll = std::chrono::milliseconds(20);  // the servo thread does not wake the loader

  struct Slot {
    std::atomic<std::size_t> index{kNone};
    std::atomic<const Block*> block{nullptr};
  };

  [[nodiscard]] bool in_window(std::size_t index, std::size_t wanted) const noexcept {
    return (index + count_ - wanted) % count_ < window_;
  }

  [[nodiscard]] bool there(std::size_t index) const noexcept { return peek(index) != nullptr; }

  void run(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      std::erase_if(retired_, [&](const auto& block) {
        return std::none_of(in_use_.begin(), in_use_.end(), [&](const auto& used) { return used == block.get(); });
      });
      const std::size_t wanted = wanted_, index = next_to_load(wanted);
      if (index != kNone) {
        load(index, wanted);
        const std::lock_guard lock(mutex_);
        changed_.notify_all();
      } else {
        std::unique_lock lock(mutex_);
        changed_.wait_for(lock, stop, kPoll, [&] { return std::exchange(nudged_, false); });
      }
    }
  }

  /// Returns the first block of the window that is not loaded.
  [[nodiscard]] std::size_t next_to_load(std::size_t wanted) const {
    for (std::size_t i = 0; i < window_ && !broken_; ++i)
      if (const std::size_t index = (wanted + i) % count_; !there(index)) return index;
    return kNone;
  }

  void load(std::size_t index, std::size_t wanted) {
    // There are as many slots as blocks in the window, and this block is in none of them.
    const auto slot = std::find_if(slots_.begin(), slots_.end(),
                                   [&](const Slot& s) { return s.index == kNone || !in_window(s.index, wanted); });
    try {
      std::unique_ptr<const Block> block = load_(index);
      retired_.reserve(retired_.size() + 1);
      if (const Block* old = slot->block.exchange(nullptr)) retired_.emplace_back(old);
      slot->index = index;
      slot->block = block.release();
    } catch (const std::exception& error) {
      error_ = error.what();
      broken_ = true;
    }
  }

  std::shared_ptr<const Block> first_;
  std::size_t count_, window_;
  Load load_;
  std::vector<Slot> slots_;
  std::atomic<std::size_t> wanted_{0};
  std::array<std::atomic<const Block*>, 2> in_use_{};
  std::size_t used_ = 0;  ///< index in in_use_ of the block that get returned last
  std::atomic<bool> broken_{false};
  std::string error_;                                  ///< written once, before broken_
  std::vector<std::unique_ptr<const Block>> retired_;  ///< used by the loader thread only
  std::mutex mutex_;
  std::condition_variable_any changed_;
  bool nudged_ = false;  ///< under mutex_
  std::jthread thread_;  ///< last: it uses everything above
};

}  // namespace haptrace
