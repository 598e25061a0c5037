#include "formats/documents/session_log.h"

#include "base/json_reader.h"
#include "tests/formats/support.h"

namespace haptrace {
namespace {

using nlohmann::json;

SessionLog session() {
  SessionLog log{.created = "2026-01-31T12:00:00Z",
                 .software = "haptrace 0",
                 .subject = "P07 <b>",
                 .operator_name = "Ü",
                 .notes = "line\nline",
                 .device = {"sim", "Falcon", "7"},
                 .programme = parse_json(R"({"haptrace_programme": 1, "exercises": [
                     {"shape": {"kind": "circle"}, "mode": "tunnel"}, {"shape": {"kind": "line"}, "mode": "free"}]})",
                                         "p"),
                 .paths = {"paths/1.h5", "paths/2.h5"}};
  log.sittings.push_back({.began = "a",
                          .ended = "b",
                          .ended_by = "time",
                          .detail = "c",
                          .first_trial = 0,
                          .duration = 12.5,
                          .force_dose = 3});
  log.trials.push_back({.exercise = 1,
                        .round = 2,
                        .repetition = 3,
                        .attempt = 4,
                        .settings = {.pace = 0.5, .radius = 0.004, .stiffness = 200, .assistance = 0.25, .level = 0.75},
                        .file = "x.h5",
                        .began = "d",
                        .duration = 4.25,
                        .force_dose = 1,
                        .stopped_by = "finished",
                        .detail = "e",
                        .notices = {"f", "g"},
                        .figures = {{"contour_rms_m", 0.001}, {"sparc", nullptr}},
                        .initiation = Initiation{Initiator::helped, 2.5, 0.125}});
  log.trials.push_back({.stopped_by = ""});
  return log;
}

TEST(SessionLog, IsReadBackUnchanged) {
  const TempFolder folder;
  const SessionLog log = session();
  save_session_log(log, folder.path());
  for (const std::string& where : {folder.path(), folder / kSessionFile}) {
    EXPECT_TRUE(is_session(where));
    const SessionLog read = load_session_log(where);
    EXPECT_EQ(read.subject, log.subject);
    EXPECT_EQ(read.operator_name, log.operator_name);
    EXPECT_EQ(read.notes, log.notes);
    EXPECT_EQ(read.device.serial, "7");
    EXPECT_EQ(read.programme, log.programme);
    EXPECT_EQ(read.paths, log.paths);
    ASSERT_EQ(read.sittings.size(), 1U);
    EXPECT_EQ(read.sittings[0].ended_by, "time");
    EXPECT_EQ(read.sittings[0].duration, 12.5);
    ASSERT_EQ(read.trials.size(), 2U);
    const LoggedTrial& trial = read.trials[0];
    EXPECT_EQ(trial.exercise, 1U);
    EXPECT_EQ(trial.attempt, 4);
    EXPECT_TRUE(trial.settings == log.trials[0].settings);
    EXPECT_EQ(trial.notices, log.trials[0].notices);
    EXPECT_EQ(trial.figures, log.trials[0].figures);
    ASSERT_TRUE(trial.initiation);
    EXPECT_EQ(trial.initiation->initiator, Initiator::helped);
    EXPECT_EQ(trial.initiation->waited, 2.5);
    EXPECT_EQ(trial.initiation->work, 0.125);
    EXPECT_FALSE(read.trials[1].initiation);
    EXPECT_TRUE(trial.finished());
    EXPECT_FALSE(read.trials[1].finished());
    EXPECT_FALSE(read.complete);
  }
}

TEST(SessionLog, IsReplacedAsAWhole) {
  const TempFolder folder;
  SessionLog log = session();
  save_session_log(log, folder.path());
  log.complete = true;
  save_session_log(log, folder.path());
  EXPECT_TRUE(load_session_log(folder.path()).complete);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1) << "nothing is left beside it";
}

TEST(SessionLog, NamesWhatIsWrongInIt) {
  const TempFolder folder;
  save_session_log(session(), folder.path());
  const json good = load_json(folder / kSessionFile);
  const auto expect_refused = [&](const json& log, std::initializer_list<std::string> parts) {
    const std::string file = folder.write("bad.json", log.dump());
    expect_error([&] { (void)load_session_log(file); }, Error::Kind::input, parts);
  };
  json bad = good;
  bad["trials"][0]["exercise"] = 9;
  expect_refused(bad, {"bad.json: trials[0].exercise"});
  bad = good;
  bad["trials"][0]["notices"] = {1};
  expect_refused(bad, {"trials[0]: 'notices' is not a list of texts"});
  bad = good;
  bad["programme"]["exercises"][0]["mode"] = "x";
  expect_refused(bad, {"bad.json: programme: exercises[0].mode"});
  bad = good;
  bad["paths"] = {"a"};
  expect_refused(bad, {"bad.json: paths: has 1 paths for 2 exercises"});
  bad = good;
  bad["haptrace_session"] = 2;
  expect_refused(bad, {"haptrace_session: 2"});
  expect_error([&] { (void)load_session_log(folder / "none"); }, Error::Kind::input, {"none: cannot be read"});
  EXPECT_FALSE(is_session(folder / "none"));
}

}  // namespace
}  // namespace haptrace
