// Fuzz target: commands that tune a session, one per line.
#include "player/tuning/live_tuning.h"
#include "tests/fuzz/fuzz.h"

#include <algorithm>

using namespace haptrace;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const double largest_kp = 5000, largest_kd = 50;
  LiveTuning tuning({.gains = {Vec3::Constant(1000), Vec3::Constant(10)}},
                    {.limits = {.largest = {Vec3::Constant(largest_kp), Vec3::Constant(largest_kd)}},
                     .composed = {true, true, true, true, true, true}});
  std::string_view text = fuzz::text_of(data, size);
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string answer = tuning.obey(text.substr(0, end));
    fuzz::require(!answer.empty() &&
                  std::all_of(answer.begin(), answer.end(), [](char c) { return c >= ' ' && c <= '~'; }));
    const Tuning wanted = tuning.wanted();
    for (int axis = 0; axis < 3; ++axis)
      fuzz::require(wanted.gains.kp[axis] >= 0 && wanted.gains.kp[axis] <= largest_kp && wanted.gains.kd[axis] >= 0 &&
                    wanted.gains.kd[axis] <= largest_kd);
    for (const double share : {wanted.inertia, wanted.gravity, wanted.friction, wanted.observer, wanted.learning})
      fuzz::require(share >= 0 && share <= 1);
    fuzz::require(wanted.observer_hz > 0 && wanted.observer_hz <= 100);
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return 0;
}
