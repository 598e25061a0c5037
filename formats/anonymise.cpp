#include "formats/anonymise.h"

#include "formats/recording_formats.h"
#include "formats/text_file.h"
#include "formats/warning_json.h"

#include <algorithm>
#include <array>
#include <fmt/format.h>

namespace haptrace {
namespace {

using nlohmann::json;

/// Options whose texts are names of choices, and a device's options whose values are.
constexpr std::array<std::string_view, 9> kChoices{"verb", "clock",         "velocity", "on-deviation", "method",
                                                   "mode", "interpolation", "shape",    "plane"};
constexpr std::array<std::string_view, 3> kDeviceChoices{"preset", "hand", "seed"};

template <class Names>
bool is_one_of(std::string_view word, const Names& names) {
  return std::find(names.begin(), names.end(), word) != names.end();
}

/// "sim:preset=falcon,intent=/home/jane/a.csv" -> "sim:preset=falcon"; `complete` false when anything went.
std::string device_choices(std::string_view text, bool& complete) {
  const std::size_t colon = text.find(':');
  std::string kept(text.substr(0, colon));
  complete = true;
  if (colon == std::string_view::npos) return kept;
  text.remove_prefix(colon + 1);
  char separator = ':';
  while (!text.empty()) {
    const std::string_view option = text.substr(0, text.find(','));
    text.remove_prefix(std::min(text.size(), option.size() + 1));
    const std::size_t equals = option.find('=');
    double number = 0;
    const bool choice =
        equals != std::string_view::npos &&
        (is_one_of(option.substr(0, equals), kDeviceChoices) || parse_number(option.substr(equals + 1), number)) &&
        option.find('/') == std::string_view::npos && option.find("serial") == std::string_view::npos;
    complete = complete && choice;
    if (!choice) continue;
    kept += separator;
    kept += option;
    separator = ',';
  }
  return kept;
}

class Anonymised final : public AnonymisedSource {
 public:
  explicit Anonymised(std::unique_ptr<RecordingSource> source)
      : source_(std::move(source)), header_(source_->header()), events_(source_->events()) {
    const auto drop = [&](std::string& text, const char* name) {
      if (!text.empty()) report_.dropped.emplace_back(name);
      text.clear();
    };
    drop(header_.subject, "subject");
    drop(header_.operator_name, "operator");
    drop(header_.notes, "notes");
    drop(header_.device_serial, "device_serial");
    drop(header_.uuid, "uuid");
    for (const auto& [key, value] : header_.meta) report_.dropped.push_back("meta." + key);
    header_.meta.clear();
    clean(header_.config, "config", "");
    if (header_.config.is_null()) header_.config = json::object();
    header_.uuid = new_uuid();
    for (StoredEvent& event : events_) clean(event);
    clean_warnings();
    const auto keep = [&](const std::string& text, const char* name) {
      if (!text.empty()) report_.kept.emplace_back(name);
    };
    keep(header_.title, "title");
    keep(header_.created, "created");
    keep(header_.device_name, "device_name");
  }

  [[nodiscard]] const RecordingHeader& header() const override { return header_; }
  [[nodiscard]] const RecordingColumns& columns() const override { return source_->columns(); }
  [[nodiscard]] std::vector<StoredEvent> events() const override { return events_; }
  std::span<const Sample> next() override { return source_->next(); }
  [[nodiscard]] double fraction() const override { return source_->fraction(); }
  [[nodiscard]] const AnonymiseReport& report() const override { return report_; }

  /// Those of the source may name files.
  [[nodiscard]] std::vector<std::string> notes() const override { return source_->notes(); }

 private:
  /// Numbers and truths stay, texts only where they name a choice. A value that goes becomes null and its key with it.
  void clean(json& value, const std::string& where, const std::string& key) {
    if (value.is_object()) {
      for (auto item = value.begin(); item != value.end();) {
        clean(item.value(), where + "." + item.key(), item.key());
        item = item.value().is_null() ? value.erase(item) : std::next(item);
      }
    } else if (value.is_array()) {
      for (json& item : value) clean(item, where, key);
      std::erase_if(value.get_ref<json::array_t&>(), [](const json& item) { return item.is_null(); });
    } else if (value.is_string() && key == "device") {
      bool complete = true;
      value = device_choices(value.get<std::string>(), complete);
      if (!complete) dropped(where);
    } else if ((value.is_string() && !is_one_of(key, kChoices)) || key.find("serial") != std::string::npos) {
      value = nullptr;
      dropped(where);
    }
  }

  void dropped(const std::string& where) {
    if (!is_one_of(where, report_.dropped)) report_.dropped.push_back(where);
  }

  /// Texts that haptrace makes of numbers stay; all others become the name of their kind.
  void clean(StoredEvent& event) {
    const auto code = static_cast<EventCode>(event.code);
    constexpr std::array kOfNumbers{
        EventCode::overrun,           EventCode::samples_lost,   EventCode::force_limit,
        EventCode::continuous_limit,  EventCode::velocity_limit, EventCode::deviation_limit,
        EventCode::deviation_over,    EventCode::not_finite,     EventCode::device_not_ready,
        EventCode::device_ready,      EventCode::device_lost,    EventCode::oscillation,
        EventCode::oscillation_stays, EventCode::warming,        EventCode::hand_resists,
        EventCode::hand_let_go,       EventCode::device_found,   EventCode::time_over,
        EventCode::rotation_limit,    EventCode::touched,        EventCode::left};
    if (is_one_of_codes(code, kOfNumbers)) return;
    std::string text = code == EventCode::repetition ? "repetition" : describe({0, code, {}});
    if (code == EventCode::repetition && event.text.starts_with("repetition ") &&
        event.text.find_first_not_of("0123456789", 11) == std::string::npos)
      return;
    if (text == event.text) return;
    event.text = std::move(text);
    ++report_.texts;
  }

  /// Those of events are made of numbers; the others may name files and people.
  void clean_warnings() {
    std::vector<Warning> warnings = warnings_from(header_.warnings);
    for (Warning& warning : warnings) {
      if (is_of_event(warning.code)) continue;
      warning.text = warning.code;
      ++report_.texts;
    }
    header_.warnings = json_of(warnings);
  }

  template <class Codes>
  static bool is_one_of_codes(EventCode code, const Codes& codes) {
    return std::find(codes.begin(), codes.end(), code) != codes.end();
  }

  std::unique_ptr<RecordingSource> source_;
  RecordingHeader header_;
  std::vector<StoredEvent> events_;
  AnonymiseReport report_;
};

}  // namespace

std::unique_ptr<AnonymisedSource> anonymise(std::unique_ptr<RecordingSource> source) {
  return std::make_unique<Anonymised>(std::move(source));
}

}  // namespace haptrace
