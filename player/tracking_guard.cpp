#include "player/tracking_guard.h"

#include <utility>

namespace haptrace {

void TrackingGuard::watch(const State& state, const Reference& reference, const Vec3& feedback) noexcept {
  State loop = state;
  loop.force_applied = feedback;
  if (const auto event = softener_.update(monitor_.update(loop, reference), state.dt)) oscillation_ = event;
  const Vec3 error = reference.position - state.position;
  if (const auto event = hand_.update(state.force_applied, error, nan3(), state.dt)) hand_event_ = event;
}

std::optional<Event> TrackingGuard::take_event() noexcept {
  return oscillation_ ? std::exchange(oscillation_, std::nullopt) : std::exchange(hand_event_, std::nullopt);
}

}  // namespace haptrace
