// The commands of a session that only records.
#pragma once

#include "player/tuning/live_session.h"

namespace haptrace {

/// Obeys the commands of every session (LiveSession). A pause leaves samples out of the recording. Nothing else can be
/// changed: without a scene no force acts, and a scene is as its file states.
class LiveRecording final : public LiveSession {
 public:
  LiveRecording(std::shared_ptr<Annotations> annotations, StopRequest& stop)
      : LiveSession({.annotations = std::move(annotations), .stop = &stop, .records = true}) {}

 private:
  [[nodiscard]] const std::vector<std::string>& quantities() const override;
  [[nodiscard]] std::string help() const override { return "this session has no values to change"; }
  std::string change(const std::string& name, Words values) override;
  std::string reset() override { return ""; }
  [[nodiscard]] std::string text_of(const std::string& name) const override { return name; }
  [[nodiscard]] nlohmann::json state() const override;
  [[nodiscard]] std::vector<LiveControl> list_controls() const override { return {}; }
  [[nodiscard]] std::string summarise() const override { return ""; }
};

}  // namespace haptrace
