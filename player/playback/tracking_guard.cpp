#include "player/playback/tracking_guard.h"

#include <utility>

namespace haptrace {

void TrackingGuard::watch(const State& state, const Reference& reference, const Vec3& feedback) noexcept {
  if (monitor_) {
    State loop = state;
    loop.force_applied = feedback;
    since_told_ += state.dt;
    if (const auto verdict = monitor_->update(loop, reference); verdict && since_told_ >= kSpacing) {
      since_told_ = 0;
      oscillation_ = Event{.code = EventCode::oscillation, .values = {verdict->amplitude, verdict->frequency_hz, kNaN}};
    }
  }
  const Vec3 error = reference.position - state.position;
  if (const auto event = hand_.update(state.force_applied, error, nan3(), state.dt)) hand_event_ = event;
}

std::optional<Event> TrackingGuard::take_event() noexcept {
  return oscillation_ ? std::exchange(oscillation_, std::nullopt) : std::exchange(hand_event_, std::nullopt);
}

}  // namespace haptrace
