// Exchange of packets with a Falcon's firmware.
#pragma once

#include "devices/falcon/link.h"
#include "devices/falcon/protocol.h"

#include <optional>

namespace haptrace {

/// Sends one packet after the other and waits for the answer to each. Answers carry no sequence number, so a late
/// answer could be taken for the answer to the next packet, and shift all later ones. The dialogue therefore counts
/// outstanding answers: while there are any, it waits for the newest. Before the next packet it discards unsolicited
/// bytes.
///
/// After this process was stopped, answers from before and meanwhile are waiting, including those to its guardian's
/// packets. They show an old position of the handle. The dialogue discards them and waits until the line is quiet
/// before it sends the next packet.
///
/// Threads: one at a time. Not real-time: it waits.
class FalconDialogue {
 public:
  static constexpr double kAnswerTime = 0.005;  ///< timeout; an answer takes 1 to 2 ms [s]

  /// `link` must outlive the dialogue.
  explicit FalconDialogue(FalconLink& link) : link_(link) {}

  /// Sends `packet` and returns the answer; nothing if none came within kAnswerTime. Lasts at most three times that
  /// long, unless it first waits for a quiet line. Throws what the link throws.
  std::optional<FalconReport> ask(const FalconPacket& packet);

 private:
  [[nodiscard]] bool listen(std::optional<FalconPacket>& newest, double timeout);

  FalconLink& link_;
  FalconDecoder decoder_;
  unsigned owed_ = 0;          ///< outstanding answers
  std::int64_t asked_ns_ = 0;  ///< time of the last ask() [ns]; 0: never
};

}  // namespace haptrace
