// Hands the samples of a running session to the thread of the view. Private to view.
#pragma once

#include "control/sample.h"

#include <atomic>
#include <boost/lockfree/spsc_queue.hpp>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <thread>

namespace haptrace {

/// A ring from the servo loop to the thread of the view.
///
/// Threads: push and between_ticks from the servo loop; take from one other thread; prepare while there is no session.
/// Real-time: push. A full ring loses samples, which are counted.
class LiveSink final : public SampleSink {
 public:
  /// Makes rings for sessions of `rate_hz`.
  void prepare(double rate_hz) {
    const auto rows = static_cast<std::size_t>(std::max(kSmallestRing, std::ceil(kRingSeconds * rate_hz)));
    if (!rings_ || rows != rows_) rings_ = std::make_unique<Rings>(rows);
    rows_ = rows;
    rings_->samples.consume_all([](const Sample&) {});
    rings_->events.consume_all([](const Event&) {});
    rings_->contacts.consume_all([](const ContactSample&) {});
    strongest_ = {.tick = static_cast<std::uint64_t>(-1)};
    touched_ = false;
    waiting_.reset();
    lost_.store(0, std::memory_order_relaxed);
  }

  void push(const Sample& sample) noexcept override {
    if (touched_) (void)rings_->contacts.push(strongest_);
    touched_ = false;
    if (!rings_->samples.push(sample)) lost_.fetch_add(1, std::memory_order_relaxed);
  }
  void push(const Event& event) noexcept override { (void)rings_->events.push(event); }
  /// Keeps the strongest contact of a tick.
  void push_contact(const ContactSample& contact) noexcept override {
    if (strongest_.tick == contact.tick && strongest_.force.squaredNorm() >= contact.force.squaredNorm()) return;
    strongest_ = contact;
    touched_ = true;
  }

  void between_ticks(bool may_wait) noexcept override {
    while (may_wait && rings_->samples.write_available() == 0 && waits_.load(std::memory_order_relaxed))
      std::this_thread::sleep_for(std::chrono::microseconds(100));
  }

  /// Stops or allows waiting for room: the thread of the view must run for that.
  void let_wait(bool allowed) noexcept { waits_.store(allowed, std::memory_order_relaxed); }

  /// Takes what has arrived: samples first, since the events of a sample's tick are pushed before it. Returns true if
  /// there was anything.
  template <class TakeSample, class TakeEvent>
  bool take(const TakeSample& sample, const TakeEvent& event) {
    const std::size_t samples =
        rings_->samples.consume_all([&](const Sample& taken) { sample(taken, contact_of(taken.tick)); });
    return rings_->events.consume_all(event) + samples > 0;
  }

  [[nodiscard]] std::uint64_t lost() const noexcept { return lost_.load(std::memory_order_relaxed); }

 private:
  /// Returns the contact of a tick, which was pushed before its sample; null if nothing was touched.
  const ContactSample* contact_of(std::uint64_t tick) {
    while (!waiting_ || waiting_->tick < tick) {
      ContactSample next;
      if (!rings_->contacts.pop(next)) return nullptr;
      waiting_ = next;
    }
    return waiting_->tick == tick ? &*waiting_ : nullptr;
  }

  static constexpr double kRingSeconds = 2, kSmallestRing = 16384;  // [s], rows
  static constexpr std::size_t kMostEvents = 4096;

  struct Rings {
    explicit Rings(std::size_t rows) : samples(rows), events(kMostEvents), contacts(rows) {}
    boost::lockfree::spsc_queue<Sample> samples;
    boost::lockfree::spsc_queue<Event> events;
    boost::lockfree::spsc_queue<ContactSample> contacts;
  };

  std::unique_ptr<Rings> rings_ = std::make_unique<Rings>(static_cast<std::size_t>(kSmallestRing));
  std::size_t rows_ = static_cast<std::size_t>(kSmallestRing);
  ContactSample strongest_{.tick = static_cast<std::uint64_t>(-1)};  ///< of the present tick; used by the loop
  bool touched_ = false;
  std::optional<ContactSample> waiting_;  ///< the next contact; used by the thread of the view
  std::atomic<std::uint64_t> lost_{0};
  std::atomic<bool> waits_{true};
};

}  // namespace haptrace
