#include "devices/falcon/dialogue.h"

#include "devices/loop/clock.h"

#include <algorithm>
#include <array>

namespace haptrace {
namespace {

constexpr std::int64_t kStoodStill = 50'000'000;  // longer than the regular pause between two packets [ns]
constexpr double kQuiet = 0.005;                  // silence after which no more bytes are expected [s]
constexpr int kStaleReads = 16;                   // limit, because a line may never be silent

std::int64_t falcon_answer_deadline() {
  return monotonic_ns() + static_cast<std::int64_t>(1e9 * FalconDialogue::kAnswerTime);
}

}  // namespace

/// Reads available bytes into `newest`. Returns whether any byte came.
bool FalconDialogue::listen(std::optional<FalconPacket>& newest, double timeout) {
  std::array<std::uint8_t, 256> bytes{};
  const std::size_t count = link_.read(bytes, timeout);
  for (std::size_t i = 0; i < count; ++i)
    if (const auto packet = decoder_.push(bytes[i])) {
      newest = packet;
      if (owed_ > 0) --owed_;
    }
  return count > 0;
}

std::optional<FalconReport> FalconDialogue::ask(const FalconPacket& packet) {
  std::optional<FalconPacket> newest;
  const std::int64_t begin = monotonic_ns();
  const bool stood_still = asked_ns_ > 0 && begin - asked_ns_ > kStoodStill;
  asked_ns_ = begin;
  for (int reads = 0; reads < kStaleReads && listen(newest, stood_still ? kQuiet : 0); ++reads) {
  }
  if (stood_still) owed_ = 0;
  newest.reset();

  ++owed_;  // even if only a part of the packet is sent
  if (!link_.write(encode(packet), kAnswerTime)) return std::nullopt;
  std::int64_t deadline = falcon_answer_deadline();
  while (owed_ > 0) {
    const bool had_none = !newest;
    const double left = 1e-9 * static_cast<double>(deadline - monotonic_ns());
    if (!listen(newest, std::max(left, 0.0)) || left <= 0) break;
    if (had_none && newest) deadline = falcon_answer_deadline();  // allows time for further answers
  }
  if (!newest || monotonic_ns() - begin > kStoodStill) return std::nullopt;
  owed_ = 0;
  return falcon_report(*newest);
}

}  // namespace haptrace
