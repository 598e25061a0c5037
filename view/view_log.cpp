#include "view/view_log.h"

#include "control/event_words.h"
#include "control/warning.h"
#include "view/view_time.h"

#include <utility>

namespace haptrace {
nlohmann::json event_json(double time, std::int32_t code, const std::string& text) {
  const EventWords* words = words_of(static_cast<EventCode>(code));
  const char* severity = "";
  if (words != nullptr && words->severity) severity = to_string(*words->severity);
  if (words != nullptr && words->stops) severity = to_string(Severity::problem);
  if (code == static_cast<std::int32_t>(EventCode::interrupted)) severity = "";
  return {{"time", time},
          {"code", code},
          {"name", words != nullptr ? words->name : ""},
          {"text", text},
          {"severity", severity}};
}

nlohmann::json event_json(const Event& event) {
  return event_json(seconds(event.time_ns), static_cast<std::int32_t>(event.code), describe(event));
}

nlohmann::json event_json(const StoredEvent& event) {
  return event_json(event.time, event.code, event.text);
}

nlohmann::json events_message(nlohmann::json list, bool reset) {
  return {{"type", "events"}, {"reset", reset}, {"list", std::move(list)}};
}

bool PhaseLog::add(std::int64_t time_ns, Phase phase) {
  if (open_.to >= 0 && open_.phase == phase) {
    open_.to = time_ns;
    return false;
  }
  const bool ended = open_.to >= 0;
  if (ended) {
    open_.to = time_ns;
    if (ended_.size() < kMost) ended_.push_back(open_);
  }
  open_ = {time_ns, time_ns, phase};
  return ended;
}

void PhaseLog::finish() {
  if (open_.to >= 0 && ended_.size() < kMost) ended_.push_back(open_);
  open_.to = -1;
}

nlohmann::json PhaseLog::message(std::size_t first, bool reset, bool done) const {
  nlohmann::json list = nlohmann::json::array();
  for (std::size_t i = first; i < ended_.size(); ++i)
    list.push_back({seconds(ended_[i].from), seconds(ended_[i].to), to_string(ended_[i].phase)});
  return {{"type", "phases"}, {"reset", reset}, {"list", std::move(list)}, {"done", done}};
}

nlohmann::json PhaseLog::take(bool done) {
  return message(std::exchange(taken_, ended_.size()), false, done);
}

}  // namespace haptrace
