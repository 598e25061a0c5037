#include "devices/falcon/dialogue.h"

#include "devices/clock.h"

#include <algorithm>
#include <array>

namespace haptrace {
namespace {

constexpr int kStaleReads = 16;  // at most; a line that is never silent holds nobody up

std::int64_t falcon_answer_deadline() {
  return monotonic_ns() + static_cast<std::int64_t>(1e9 * FalconDialogue::kAnswerTime);
}

}  // namespace

/// Whether anything came.
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
  for (int reads = 0; reads < kStaleReads && listen(newest, 0); ++reads) {
  }
  newest.reset();

  ++owed_;  // also when the packet was sent in part
  if (!link_.write(encode(packet), kAnswerTime)) return std::nullopt;
  std::int64_t deadline = falcon_answer_deadline();
  while (owed_ > 0) {
    const bool had_none = !newest;
    const double left = 1e-9 * static_cast<double>(deadline - monotonic_ns());
    if (!listen(newest, std::max(left, 0.0)) || left <= 0) break;
    if (had_none && newest) deadline = falcon_answer_deadline();  // for what may come after it
  }
  if (!newest) return std::nullopt;
  owed_ = 0;
  return falcon_report(*newest);
}

}  // namespace haptrace
