#include "player/record_controllers.h"

#include <utility>

namespace haptrace {

Command TimedController::update(const State& state) noexcept {
  Command command = inner_.update(state);
  if (kept_) std::swap(kept_, command.event);
  if (waits_) {
    const auto fired = trigger_->check(state);
    if (!fired) return command;
    kept_ = std::exchange(command.event, fired);
    waits_ = false;  // the trigger is kept: a tick must not free memory
    begin_ns_ = state.time_ns;
  }
  if (duration_ > 0 && 1e-9 * static_cast<double>(state.time_ns - begin_ns_) >= duration_)
    command.status = Command::Status::finished;
  return command;
}

}  // namespace haptrace
