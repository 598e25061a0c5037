// Packets to a Falcon's firmware, and the answers to them.
#pragma once

#include "devices/falcon/link.h"
#include "devices/falcon/protocol.h"

#include <optional>

namespace haptrace {

/// Asks one packet after the other. An answer carries no number: one that comes late could be taken for that to the
/// next packet, and every later one with it. So the answers still owed are counted, and as long as some are, the
/// newest that comes is waited for; what came unasked is thrown away before the next packet.
///
/// A process that was stopped finds answers that came before or meanwhile, among them those to its guardian's packets:
/// they show where the handle was. None of them is taken for one, and the next packet waits until the line is quiet.
///
/// Threads: one at a time. Not real-time: it waits.
class FalconDialogue {
 public:
  static constexpr double kAnswerTime = 0.005;  ///< an answer takes 1 to 2 ms [s]

  /// The link has to outlive it.
  explicit FalconDialogue(FalconLink& link) : link_(link) {}

  /// Nothing when no answer came within kAnswerTime. Lasts three times as long at most. Throws what the link throws.
  std::optional<FalconReport> ask(const FalconPacket& packet);

 private:
  [[nodiscard]] bool listen(std::optional<FalconPacket>& newest, double timeout);

  FalconLink& link_;
  FalconDecoder decoder_;
  unsigned owed_ = 0;          ///< answers
  std::int64_t asked_ns_ = 0;  ///< when ask() was called last; 0: never
};

}  // namespace haptrace
