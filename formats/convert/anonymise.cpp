#include "formats/convert/anonymise.h"

#include "base/printable.h"
#include "base/text_file.h"
#include "control/event_words.h"
#include "formats/documents/warning_json.h"
#include "formats/recording/recording_formats.h"

#include <algorithm>
#include <array>
#include <fmt/format.h>
#include <set>

namespace haptrace {
namespace {

using nlohmann::json;

/// Options whose texts name a choice, and device options whose values do.
constexpr std::array<std::string_view, 11> kChoices{"verb",          "clock",        "up",     "velocity",
                                                    "on-deviation",  "on-page-lost", "method", "mode",
                                                    "interpolation", "shape",        "plane"};
constexpr std::array<std::string_view, 8> kDeviceChoices{"preset",     "hand",       "seed", "emulated",
                                                         "integrator", "generation", "fit",  "fault"};
/// Options whose values users choose freely. One may look like a number, such as that of a participant.
constexpr std::array<std::string_view, 15> kPersonal{"title",     "subject", "operator",   "notes", "meta",
                                                     "meta-file", "record",  "mark-texts", "path",  "output",
                                                     "programme", "learned", "profile",    "gains", "scene"};

/// Returns true if the key identifies one thing among its kind.
bool is_identifier(std::string_view key) {
  return key.find("serial") != std::string_view::npos || key == "id" || key.ends_with("_id") || key.ends_with("-id") ||
         key == "name" || key == "port" || key == "uuid";
}

/// Calls `visit` for every run of letters. All bytes beyond ASCII count as letters.
template <class Visit>
void for_each_word(std::string_view text, const Visit& visit) {
  const auto is_letter = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || static_cast<unsigned char>(c) >= 0x80;
  };
  for (std::size_t i = 0; i < text.size();) {
    std::size_t end = i;
    while (end < text.size() && is_letter(text[end])) ++end;
    if (end > i) visit(text.substr(i, end - i));
    i = std::max(end, i + 1);
  }
}

template <class Names>
bool is_one_of(std::string_view word, const Names& names) {
  return std::find(names.begin(), names.end(), word) != names.end();
}

/// Shortens "sim:preset=falcon,intent=/home/jane/a.csv" to "sim:preset=falcon"; sets `complete` to false if it drops
/// anything. It keeps the numbers of a simulated device. Those of a real device may be on its label, and a plug-in's
/// may mean anything.
std::string device_choices(std::string_view text, bool& complete) {
  const std::size_t colon = text.find(':');
  std::string kept(text.substr(0, colon));
  complete = true;
  if (colon == std::string_view::npos) return kept;
  const bool simulated = kept == "sim";
  text.remove_prefix(colon + 1);
  char separator = ':';
  while (!text.empty()) {
    const std::string_view option = text.substr(0, text.find(','));
    text.remove_prefix(std::min(text.size(), option.size() + 1));
    const std::size_t equals = std::min(option.find('='), option.size());
    const std::string_view key = option.substr(0, equals), value = option.substr(std::min(equals + 1, option.size()));
    double number = 0;
    const bool choice = (is_one_of(key, kDeviceChoices) || (simulated && parse_number(value, number))) &&
                        !is_identifier(key) && value.find('/') == std::string_view::npos;
    complete = complete && choice;
    if (!choice) continue;
    kept += separator;
    kept += option;
    separator = ',';
  }
  return kept;
}

/// Returns the words that describe() and warning_of() use, in their original case.
const std::set<std::string>& words_of_events() {
  static const std::set<std::string> kWords = [] {
    std::set<std::string> words{"inf", "nan", "e"};
    for (const char* earlier : {"asked", "disk", "follows", "none", "refused", "what"})  // in texts of version 1.0
      words.emplace(earlier);
    for (int code = 0; code < 256; ++code)
      for (const double value : {0.0, 1.0, 2.0, kNaN}) {
        const std::string text = describe({0, static_cast<EventCode>(code), {value, value, value}});
        for_each_word(text, [&](std::string_view word) { words.emplace(word); });
      }
    for (const EventWords& event : event_words())
      for (const std::uint64_t count : {1U, 2U}) {
        const Event one{0, event.code, {1, 1, 1}};
        for_each_word(warning_of(event, {count, one, one}).text, [&](std::string_view word) { words.emplace(word); });
      }
    return words;
  }();
  return kWords;
}

/// Returns true if a text consists of numbers and words of events only, so that haptrace wrote it.
bool is_made_of_numbers(std::string_view text) {
  bool known = find_invalid_utf8(text) == std::string_view::npos;
  for_each_word(text, [&](std::string_view word) { known = known && words_of_events().contains(std::string(word)); });
  return known;
}

std::string nameless(int code) {
  return fmt::format("event {}", code);
}

/// Returns a description of an event kind without its values.
std::string plain_text(EventCode code) {
  if (code == EventCode::repetition) return "repetition";
  const std::string text = describe({0, code, {0, 0, 0}});
  const bool of_values = text != describe({0, code, {1, 1, 1}}) || text != describe({0, code, {kNaN, kNaN, kNaN}});
  return of_values ? nameless(static_cast<int>(code)) : text;
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
    if (!source_->clocks().empty()) report_.dropped.emplace_back("clocks");
    drop(header_.part_of, "part_of");
    header_.part = 0;
    bool complete = true;
    header_.device_name = device_choices(header_.device_name, complete);
    if (!complete) report_.dropped.emplace_back("device_name");
    if (!header_.software.starts_with("haptrace ") || find_invalid_utf8(header_.software) != std::string::npos)
      drop(header_.software, "software");
    for (const auto& [key, value] : header_.meta) report_.dropped.push_back("meta." + key);
    header_.meta.clear();
    if (!header_.scene.empty()) report_.dropped.emplace_back("scene");
    header_.scene = {};
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
    keep(header_.device_model, "device_model");
  }

  [[nodiscard]] const RecordingHeader& header() const override { return header_; }
  [[nodiscard]] const RecordingColumns& columns() const override { return source_->columns(); }
  [[nodiscard]] std::vector<StoredEvent> events() const override { return events_; }
  std::span<const Sample> next() override { return source_->next(); }
  [[nodiscard]] std::span<const ContactSample> contacts() const override { return source_->contacts(); }
  [[nodiscard]] double fraction() const override { return source_->fraction(); }
  [[nodiscard]] const AnonymiseReport& report() const override { return report_; }

  /// Passes on the source's notes, which may name files. No sink stores them.
  [[nodiscard]] std::vector<std::string> notes() const override { return source_->notes(); }

 private:
  /// Keeps numbers and booleans, and texts that name a choice. A dropped value becomes null and loses its key.
  void clean(json& value, const std::string& where, const std::string& key) {
    const bool own = is_one_of(key, kPersonal) || is_identifier(key);
    const bool free_text = value.is_string() && key != "device" && !is_one_of(key, kChoices);
    if (value.is_object()) {
      for (auto item = value.begin(); item != value.end();) {
        clean(item.value(), where + "." + item.key(), item.key());
        item = item.value().is_null() ? value.erase(item) : std::next(item);
      }
    } else if (!value.is_null() && (own || free_text)) {
      value = nullptr;
      dropped(where);
    } else if (value.is_array()) {
      for (json& item : value) clean(item, where, key);
      std::erase_if(value.get_ref<json::array_t&>(), [](const json& item) { return item.is_null(); });
    } else if (value.is_string() && key == "device") {
      bool complete = true;
      value = device_choices(value.get<std::string>(), complete);
      if (!complete) dropped(where);
    }
  }

  void dropped(const std::string& where) {
    if (!is_one_of(where, report_.dropped)) report_.dropped.push_back(where);
  }

  /// Keeps texts that haptrace makes of numbers. Replaces all others by the name of their kind.
  void clean(StoredEvent& event) {
    const auto code = static_cast<EventCode>(event.code);
    const bool free = code == EventCode::mark || describe({0, code, {}}) == nameless(event.code);
    const std::string plain = plain_text(code);
    if (event.text == plain || (!free && is_made_of_numbers(event.text))) return;
    event.text = plain;
    ++report_.texts;
  }

  /// Keeps warnings of events, which are made of numbers. Other warnings may name files and people.
  void clean_warnings() {
    std::vector<Warning> warnings = warnings_from(header_.warnings);
    for (Warning& warning : warnings) {
      if ((is_of_event(warning.code) || warning.code == "stopped") && is_made_of_numbers(warning.text)) continue;
      const bool is_kind = warning.code.size() <= 32 &&
                           warning.code.find_first_not_of("abcdefghijklmnopqrstuvwxyz_") == std::string::npos;
      if (!is_kind) warning.code = "other";
      warning.text = warning.code;
      ++report_.texts;
    }
    header_.warnings = json_of(warnings);
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
