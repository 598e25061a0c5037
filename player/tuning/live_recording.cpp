#include "player/tuning/live_recording.h"

#include "base/error.h"

#include <nlohmann/json.hpp>

namespace haptrace {

const std::vector<std::string>& LiveRecording::quantities() const {
  static const std::vector<std::string> none;
  return none;
}

std::string LiveRecording::change(const std::string& name, Words) {
  throw input_error(name + ": a recording has no such value");
}

nlohmann::json LiveRecording::state() const {
  return nlohmann::json::object();
}

}  // namespace haptrace
