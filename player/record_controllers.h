// Controllers of recordings.
#pragma once

#include "control/controller.h"
#include "control/trigger.h"

#include <cstdint>
#include <optional>
#include <utility>

namespace haptrace {

/// Sends no force: the hand moves freely, and the loop records it.
class PassiveController final : public Controller {
 public:
  [[nodiscard]] Command update(const State&) noexcept override { return {}; }
};

/// Ends another controller after a given time and reports when its trigger fires.
class TimedController final : public Controller {
 public:
  /// Ends `duration` [s] after the start or, if there is a trigger, after it fired, which is reported as an event. 0:
  /// never ends. `inner` must outlive this object.
  TimedController(Controller& inner, double duration, std::optional<Trigger> trigger = std::nullopt)
      : inner_(inner), duration_(duration), trigger_(std::move(trigger)), waits_(trigger_.has_value()) {}

  void start(const State& first) noexcept override { inner_.start(first); }
  void resume(const State& first) noexcept override { inner_.resume(first); }
  [[nodiscard]] Command update(const State& state) noexcept override;
  void between_ticks(bool may_wait) noexcept override { inner_.between_ticks(may_wait); }

 private:
  Controller& inner_;
  double duration_;
  std::optional<Trigger> trigger_;
  bool waits_;  ///< waits for the trigger
  std::int64_t begin_ns_ = 0;
  std::optional<Event> kept_;  ///< event of `inner_`, delayed by the trigger's event
};

}  // namespace haptrace
