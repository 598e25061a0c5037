// Events and phases of a session, as pages get them. Private to view.
#pragma once

#include "control/sample.h"
#include "formats/recording/recording.h"

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace haptrace {

/// Returns an event for the message `events`.
nlohmann::json event_json(double time, std::int32_t code, const std::string& text);
nlohmann::json event_json(const Event& event);
nlohmann::json event_json(const StoredEvent& event);

/// Returns the message `events`.
nlohmann::json events_message(nlohmann::json list, bool reset);

/// Collects the stretches of the phases of a session.
class PhaseLog {
 public:
  /// Adds a row. Returns true if a stretch ended with the row before.
  bool add(std::int64_t time_ns, Phase phase);

  /// Ends the last stretch.
  void finish();

  /// Returns the message `phases` with the stretches that ended since the last call, or with all.
  nlohmann::json take(bool done);
  [[nodiscard]] nlohmann::json all(bool done) const { return message(0, true, done); }

  /// Returns the message with the stretches from the one of this number on. `reset`: they replace earlier ones.
  [[nodiscard]] nlohmann::json message(std::size_t first, bool reset, bool done) const;
  [[nodiscard]] std::size_t size() const noexcept { return ended_.size(); }

 private:
  struct Stretch {
    std::int64_t from, to;
    Phase phase;
  };
  static constexpr std::size_t kMost = 4000;  ///< later stretches are not kept

  std::vector<Stretch> ended_;
  std::size_t taken_ = 0;
  Stretch open_{0, -1, Phase::idle};
};

}  // namespace haptrace
