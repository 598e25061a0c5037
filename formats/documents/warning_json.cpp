#include "formats/documents/warning_json.h"

#include "base/json_reader.h"

namespace haptrace {

nlohmann::json json_of(std::span<const Warning> warnings) {
  nlohmann::json list = nlohmann::json::array();
  for (const Warning& warning : warnings)
    list.push_back({{"severity", to_string(warning.severity)},
                    {"code", warning.code},
                    {"time_s", json_of_number(warning.time)},
                    {"text", warning.text}});
  return list;
}

std::vector<Warning> warnings_from(const nlohmann::json& list) {
  std::vector<Warning> warnings;
  const auto text_of = [](const nlohmann::json& object, const char* key) {
    const auto found = object.find(key);
    return found != object.end() && found->is_string() ? found->get<std::string>() : std::string();
  };
  if (!list.is_array()) return warnings;
  for (const nlohmann::json& each : list) {
    if (!each.is_object()) continue;
    Warning warning{.code = text_of(each, "code"), .text = text_of(each, "text")};
    if (warning.text.empty()) continue;
    const std::string severity = text_of(each, "severity");
    for (const auto known : {Severity::note, Severity::problem})
      if (severity == to_string(known)) warning.severity = known;
    if (severity == "error") warning.severity = Severity::problem;  // in files of before there was one scale
    if (const auto time = each.find("time_s"); time != each.end() && time->is_number())
      warning.time = time->get<double>();
    warnings.push_back(std::move(warning));
  }
  return warnings;
}

}  // namespace haptrace
