#include "formats/documents/session_log.h"

#include "base/error.h"
#include "base/json_reader.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

namespace haptrace {
namespace {

using nlohmann::json;

constexpr double kLongest = 1e9;

json json_of(const TrialSettings& settings) {
  json result{{"pace", settings.pace},
              {"radius", settings.radius},
              {"assistance", settings.assistance},
              {"level", settings.level}};
  if (settings.stiffness) result["stiffness"] = *settings.stiffness;
  if (settings.force_scale) result["force_scale"] = *settings.force_scale;
  if (settings.start_hold) result["start_hold_s"] = *settings.start_hold;
  if (settings.support) result["support_n"] = *settings.support;
  return result;
}

TrialSettings settings_from(JsonReader reader) {
  TrialSettings settings{.pace = reader.number("pace", 1, 0, kLongest),
                         .radius = reader.number("radius", 0, 0, kLongest),
                         .assistance = reader.number("assistance", 1, 0, 1),
                         .level = reader.number("level", 0, 0, 1)};
  if (reader.has("stiffness")) settings.stiffness = reader.number("stiffness", 0, 0, kLongest);
  if (reader.has("force_scale")) settings.force_scale = reader.number("force_scale", 1, 0, kLongest);
  if (reader.has("start_hold_s")) settings.start_hold = reader.number("start_hold_s", 0, 0, kLongest);
  if (reader.has("support_n")) settings.support = reader.number("support_n", 0, 0, kLongest);
  reader.finish();
  return settings;
}

json json_of(const ShownParts& shown) {
  json result = json::object();
  for (std::size_t part = 0; part < kScreenParts; ++part)
    result[to_string(static_cast<ScreenPart>(part))] = shown[part];
  return result;
}

ShownParts shown_from(JsonReader reader) {
  ShownParts shown{};
  for (std::size_t part = 0; part < kScreenParts; ++part)
    shown[part] = reader.boolean(to_string(static_cast<ScreenPart>(part)), true);
  reader.finish();
  return shown;
}

json json_of(const LoggedTrial& trial) {
  json result{{"exercise", trial.exercise},
              {"round", trial.round},
              {"repetition", trial.repetition},
              {"attempt", trial.attempt},
              {"settings", json_of(trial.settings)},
              {"file", trial.file},
              {"began", trial.began},
              {"duration_s", trial.duration},
              {"force_dose_n_s", trial.force_dose},
              {"stopped_by", trial.stopped_by},
              {"detail", trial.detail},
              {"notices", trial.notices},
              {"figures", trial.figures}};
  if (!trial.input.empty()) result["input"] = trial.input;
  if (trial.unattended) result["unattended"] = true;
  if (trial.shown) result["shown"] = json_of(*trial.shown);
  if (trial.initiation) result["initiation"] = haptrace::json_of(*trial.initiation);
  if (trial.reach) result["reach"] = haptrace::json_of(*trial.reach);
  if (trial.places) result["places"] = haptrace::json_of(*trial.places);
  if (trial.sense) result["sense"] = haptrace::json_of(*trial.sense);
  return result;
}

Initiation initiation_from(JsonReader reader) {
  static const std::vector<std::string> kInitiators{"none", "self", "helped"};  // as to_string() names them
  const std::string initiator = reader.choice("initiator", kInitiators.front(), kInitiators);
  Initiation initiation;
  for (const Initiator one : {Initiator::none, Initiator::self, Initiator::helped})
    if (initiator == to_string(one)) initiation.initiator = one;
  initiation.waited = reader.number("waited_s", 0, 0, kLongest);
  initiation.work = reader.number("wall_work_j", 0, -kLongest, kLongest);
  reader.finish();
  return initiation;
}

std::vector<std::string> texts_from(JsonReader& reader, const std::string& key) {
  const json value = reader.value(key);
  std::vector<std::string> texts;
  if (value.is_null()) return texts;
  const bool all_texts =
      value.is_array() && std::all_of(value.begin(), value.end(), [](const json& text) { return text.is_string(); });
  if (!all_texts) throw input_error(fmt::format("{}: '{}' is not a list of texts", reader.where(), key));
  return value.get<std::vector<std::string>>();
}

LoggedTrial trial_from(JsonReader& reader) {
  LoggedTrial trial{.exercise = static_cast<std::size_t>(reader.require("exercise").integer("exercise", 0, 0, 1 << 30)),
                    .round = reader.integer("round", 1, 1, 1 << 30),
                    .repetition = reader.integer("repetition", 1, 1, 1 << 30),
                    .attempt = reader.integer("attempt", 1, 1, 1 << 30)};
  if (std::optional<JsonReader> settings = reader.object("settings")) trial.settings = settings_from(*settings);
  trial.file = reader.text("file", "");
  trial.began = reader.text("began", "");
  trial.duration = reader.number("duration_s", 0, 0, kLongest);
  trial.force_dose = reader.number("force_dose_n_s", 0, 0, kLongest);
  trial.stopped_by = reader.text("stopped_by", "");
  trial.detail = reader.text("detail", "");
  trial.input = reader.text("input", "");
  trial.unattended = reader.boolean("unattended", false);
  if (std::optional<JsonReader> shown = reader.object("shown")) trial.shown = shown_from(*shown);
  if (std::optional<JsonReader> initiation = reader.object("initiation"))
    trial.initiation = initiation_from(*initiation);
  if (std::optional<JsonReader> reach = reader.object("reach")) trial.reach = planned_reach_from(*reach);
  if (std::optional<JsonReader> places = reader.object("places")) trial.places = reach_trial_from(*places);
  if (std::optional<JsonReader> sense = reader.object("sense")) trial.sense = sense_trial_from(*sense);
  trial.notices = texts_from(reader, "notices");
  trial.figures = reader.value("figures");
  if (!trial.figures.is_null() && !trial.figures.is_object())
    throw input_error(reader.where() + ".figures: is not an object");
  reader.finish();
  return trial;
}

json json_of(const Sitting& sitting) {
  json result{{"began", sitting.began},
              {"ended", sitting.ended},
              {"ended_by", sitting.ended_by},
              {"detail", sitting.detail},
              {"first_trial", sitting.first_trial},
              {"duration_s", sitting.duration},
              {"force_dose_n_s", sitting.force_dose}};
  if (!sitting.stopped_from.empty()) result["stopped_from"] = sitting.stopped_from;
  return result;
}

Sitting sitting_from(JsonReader& reader) {
  Sitting sitting{.began = reader.text("began", ""),
                  .ended = reader.text("ended", ""),
                  .ended_by = reader.text("ended_by", ""),
                  .stopped_from = reader.text("stopped_from", ""),
                  .detail = reader.text("detail", ""),
                  .first_trial = static_cast<std::size_t>(reader.integer("first_trial", 0, 0, 1 << 30)),
                  .duration = reader.number("duration_s", 0, 0, kLongest),
                  .force_dose = reader.number("force_dose_n_s", 0, 0, kLongest)};
  reader.finish();
  return sitting;
}

void check_exercise(const JsonReader& reader, std::size_t exercise, const Programme& programme) {
  if (exercise >= programme.size())
    throw input_error(
        fmt::format("{}.exercise: is out of range; the number of exercises is {}", reader.where(), programme.size()));
}

/// Checks that a reach belongs to its exercise.
void check_reach(const JsonReader& reader, const std::optional<PlannedReach>& reach, const Exercise& exercise) {
  if (reach.has_value() != exercise.reach.has_value())
    throw input_error(fmt::format("{}.reach: '{}' {} exercise with a cue", reader.where(), exercise.name,
                                  exercise.reach ? "is an" : "is no"));
  if (reach && (static_cast<std::size_t>(reach->target) >= exercise.reach->targets.size() ||
                static_cast<std::size_t>(reach->block) >= exercise.reach->blocks.size()))
    throw input_error(
        fmt::format("{}.reach: target {} or block {} is out of range", reader.where(), reach->target, reach->block));
}

/// Checks that a pair of places belongs to its exercise.
void check_sense(const JsonReader& reader, const std::optional<SenseTrial>& sense, const Exercise& exercise) {
  if (sense.has_value() != exercise.sense.has_value())
    throw input_error(fmt::format("{}.sense: '{}' {} exercise in mode sense", reader.where(), exercise.name,
                                  exercise.sense ? "is an" : "is no"));
  if (sense && static_cast<std::size_t>(sense->pair) >= 2 * exercise.sense->differences.size())
    throw input_error(fmt::format("{}.sense: pair {} is out of range", reader.where(), sense->pair));
}

PlannedTrial planned_from(JsonReader& reader, const Programme& programme) {
  PlannedTrial trial{.exercise = static_cast<std::size_t>(reader.integer("exercise", 0, 0, 1 << 30)),
                     .round = reader.integer("round", 1, 1, 1 << 30),
                     .repetition = reader.integer("repetition", 1, 1, 1 << 30),
                     .reach = {},
                     .sense = {}};
  if (std::optional<JsonReader> reach = reader.object("reach")) trial.reach = planned_reach_from(*reach);
  if (std::optional<JsonReader> sense = reader.object("sense")) trial.sense = sense_trial_from(*sense);
  reader.finish();
  check_exercise(reader, trial.exercise, programme);
  check_reach(reader, trial.reach, programme.exercise(trial.exercise));
  check_sense(reader, trial.sense, programme.exercise(trial.exercise));
  return trial;
}

std::filesystem::path log_file(const std::string& where) {
  const std::filesystem::path path(where);
  return std::filesystem::is_directory(path) ? path / kSessionFile : path;
}

}  // namespace

json json_of(const Initiation& initiation) {
  return {{"initiator", to_string(initiation.initiator)},
          {"waited_s", initiation.waited},
          {"wall_work_j", initiation.work}};
}

SessionLock::SessionLock(const std::string& folder)
    : folder_(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
  if (folder_ < 0) throw input_error(fmt::format("{}: cannot be opened: {}", folder, std::strerror(errno)));
  if (flock(folder_, LOCK_EX | LOCK_NB) == 0) return;
  close(folder_);
  throw input_error(fmt::format("{}: another process runs this session; wait for it, or end it", folder));
}

SessionLock::~SessionLock() {
  close(folder_);
}

void save_session_log(const SessionLog& log, const std::string& folder) {
  json result{{"haptrace_session", 1},
              {"created", log.created},
              {"software", log.software},
              {"subject", log.subject},
              {"operator", log.operator_name},
              {"notes", log.notes},
              {"device", {{"backend", log.device.backend}, {"model", log.device.model}, {"serial", log.device.serial}}},
              {"programme", log.programme},
              {"config", log.config},
              {"fit", log.fit},
              {"paths", log.paths},
              {"sittings", json::array()},
              {"trials", json::array()},
              {"complete", log.complete}};
  if (!log.schedule.empty()) {
    result["schedule"] = json::array();
    for (const PlannedTrial& trial : log.schedule) {
      result["schedule"].push_back(
          {{"exercise", trial.exercise}, {"round", trial.round}, {"repetition", trial.repetition}});
      if (trial.reach) result["schedule"].back()["reach"] = haptrace::json_of(*trial.reach);
      if (trial.sense) result["schedule"].back()["sense"] = haptrace::json_of(*trial.sense);
    }
    result["generator"] = log.generator;
  }
  for (const Sitting& sitting : log.sittings) result["sittings"].push_back(json_of(sitting));
  for (const LoggedTrial& trial : log.trials) result["trials"].push_back(json_of(trial));
  save_json(result, (std::filesystem::path(folder) / kSessionFile).string(), true);
}

SessionLog load_session_log(const std::string& where) {
  const std::string file = log_file(where).string();
  const json document = load_json(file);
  JsonReader reader(document, file);
  reader.require("haptrace_session").integer("haptrace_session", 1, 1, 1);
  SessionLog log{.created = reader.text("created", ""),
                 .software = reader.text("software", ""),
                 .subject = reader.text("subject", ""),
                 .operator_name = reader.text("operator", ""),
                 .notes = reader.text("notes", "")};
  if (std::optional<JsonReader> device = reader.object("device")) {
    log.device = {device->text("backend", ""), device->text("model", ""), device->text("serial", "")};
    device->finish();
  }
  log.programme = reader.require("programme").value("programme");
  const Programme programme = programme_from_json(log.programme, file + ": programme");
  log.config = reader.value("config");
  if (!log.config.is_object()) log.config = json::object();
  log.fit = reader.text("fit", "");
  log.paths = texts_from(reader, "paths");
  log.generator = reader.text("generator", "");
  for (JsonReader& one : reader.objects("schedule")) log.schedule.push_back(planned_from(one, programme));
  for (JsonReader& one : reader.objects("sittings")) log.sittings.push_back(sitting_from(one));
  for (JsonReader& one : reader.objects("trials")) {
    log.trials.push_back(trial_from(one));
    check_exercise(one, log.trials.back().exercise, programme);
    check_reach(one, log.trials.back().reach, programme.exercise(log.trials.back().exercise));
    check_sense(one, log.trials.back().sense, programme.exercise(log.trials.back().exercise));
  }
  log.complete = reader.boolean("complete", false);
  reader.finish();
  if (log.paths.size() != programme.size())
    throw input_error(
        fmt::format("{}: paths: has {} paths for {} exercises", file, log.paths.size(), programme.size()));
  return log;
}

bool is_session(const std::string& where) {
  std::error_code ignored;
  const std::filesystem::path path(where);
  if (std::filesystem::is_directory(path, ignored)) return std::filesystem::exists(path / kSessionFile, ignored);
  return path.filename() == kSessionFile && std::filesystem::exists(path, ignored);
}

}  // namespace haptrace
