// Tests of whole programmes on the simulated device, held by a hand that intends to follow the path.
#include "player/programme/programme_session.h"

#include "base/json_reader.h"
#include "devices/registry.h"
#include "formats/path/path_file.h"
#include "formats/recording/recording.h"
#include "metrics/recorded_trial.h"
#include "tests/support/errors.h"
#include "tests/support/not_a_tick.h"
#include "tests/support/point_mass.h"
#include "tests/support/temp_folder.h"

#include <filesystem>
#include <fmt/format.h>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <utility>

namespace haptrace {
namespace {

using nlohmann::json;
using test::error_of;
using test::PointMass;
using test::TempFolder;
using testing::AllOf;
using testing::HasSubstr;

const char* const kShape = R"("shape": {"kind": "circle", "size": 0.04, "duration": 1.5})";

/// Returns a programme of these exercises, with `keys` at its top level.
json programme_of(const std::vector<std::string>& exercises, const std::string& keys = "") {
  std::string text;
  for (const std::string& exercise : exercises)
    text += fmt::format("{}{{{}, \"rest\": 1, {}}}", text.empty() ? "" : ",", kShape, exercise);
  return parse_json(fmt::format(R"({{"haptrace_programme": 1, "title": "test", {} "exercises": [{}]}})", keys, text),
                    "p.json");
}

/// Acts once, half a second into its session.
class CommandingDevice final : public Device {
 public:
  CommandingDevice(std::shared_ptr<Device> device, std::function<void()> act)
      : device_(std::move(device)), act_(std::move(act)) {}
  ~CommandingDevice() override { device_->close(); }
  [[nodiscard]] const DeviceInfo& info() const noexcept override { return device_->info(); }
  Status exchange(const Wrench& wrench, double dt, DeviceState& state) noexcept override {
    if (++calls_ == 500) {
      const test::NotATick scope;
      act_();
    }
    return device_->exchange(wrench, dt, state);
  }
  void close() noexcept override { device_->close(); }

 private:
  std::shared_ptr<Device> device_;
  std::function<void()> act_;
  int calls_ = 0;
};

class ProgrammeSession : public testing::Test {
 protected:
  ProgrammeSession() {
    options_.folder = temp_ / "session";
    options_.session.recording.emplace();
    options_.open = [this](const Exercise&, const TrialSettings&, const std::string& path) -> std::shared_ptr<Device> {
      ++opened_;
      return open_device(fmt::format("sim:preset=omega3,hand={},seed={},intent={}", hand_, opened_, path));
    };
  }

  /// Starts a session of this programme and runs it.
  ProgrammeResult run(const json& programme) {
    const Programme read = programme_from_json(programme, "p.json");
    const auto device = open_device("sim:preset=omega3");
    const ProgrammePlan plan = plan_programme(read, temp_.path(), "p.json", &device->info(), false);
    (void)begin_session(programme, "p.json", plan, device->info(), options_);
    return run_programme(options_, stop_);
  }

  ProgrammeResult resume() {
    stop_ = std::make_unique<StopRequest>();
    return run_programme(options_, *stop_);
  }

  [[nodiscard]] std::string file(const std::string& name) const { return options_.folder + "/" + name; }

  /// Returns exercise, round, repetition and attempt of every trial, with "!" if it was not finished.
  static std::vector<std::string> trials(const SessionLog& log) {
    std::vector<std::string> all;
    for (const LoggedTrial& trial : log.trials)
      all.push_back(fmt::format("{}.{}.{}.{}{}", trial.exercise, trial.round, trial.repetition, trial.attempt,
                                trial.finished() ? "" : "!"));
    return all;
  }

  class Stop {
   public:
    Stop& operator=(std::unique_ptr<StopRequest> request) {
      request_ = std::move(request);
      return *this;
    }
    operator const StopRequest&() const { return *request_; }  // NOLINT(google-explicit-constructor)
    StopRequest& operator*() const { return *request_; }

   private:
    std::unique_ptr<StopRequest> request_ = std::make_unique<StopRequest>();
  };

  TempFolder temp_;
  ProgrammeOptions options_;
  Stop stop_;
  std::string hand_ = "relaxed";
  int opened_ = 0;
};

TEST_F(ProgrammeSession, KeepsARecordingOfEveryRepetitionInEveryMode) {
  const std::vector<std::string> modes{"passive", "assisted", "tunnel", "cursor", "resist", "free"};
  std::vector<std::string> exercises;
  for (const std::string& mode : modes)
    exercises.push_back(fmt::format(R"("name": "{0}", "mode": "{0}", "repetitions": 2 {1})", mode,
                                    mode == "resist" ? R"(, "resistance": 5)" : ""));
  const ProgrammeResult result = run(programme_of(exercises));
  EXPECT_TRUE(result.log.complete);
  ASSERT_EQ(result.log.trials.size(), 12U);
  EXPECT_EQ(result.log.sittings.at(0).ended_by, "complete");
  for (const LoggedTrial& trial : result.log.trials) {
    SCOPED_TRACE(trial.file);
    EXPECT_TRUE(trial.finished()) << trial.stopped_by << " " << trial.detail;
    for (const Finding& finding : check_recording(file(trial.file)))
      ADD_FAILURE() << finding.where << ": " << finding.what;
    const RecordingReader reader(file(trial.file));
    EXPECT_EQ(reader.header().meta.at("mode"), modes.at(trial.exercise));
    EXPECT_EQ(reader.header().meta.at("repetition"), std::to_string(trial.repetition));
    const std::vector<RecordedTrial> runs = read_trials(reader, trial.file);
    ASSERT_EQ(runs.size(), 1U);
    const double largest = std::accumulate(runs[0].force.begin(), runs[0].force.end(), 0.0,
                                           [](double most, const Vec3& f) { return std::max(most, f.norm()); });
    // The force of the approach fades over 0.3 s.
    const std::string& mode = modes.at(trial.exercise);
    if (mode == "free") {
      EXPECT_EQ(runs[0].force.back().norm(), 0);
    }
    if (mode == "passive" || mode == "cursor" || mode == "resist") {
      EXPECT_GT(largest, 0.05);
    }
    EXPECT_LT(trial.figures.at("contour_rms_m").get<double>(), 0.02);
    EXPECT_GT(trial.figures.at("completion").get<double>(), 0.9);
    const bool timed = modes.at(trial.exercise) == "passive" || modes.at(trial.exercise) == "cursor";
    EXPECT_EQ(trial.figures.at("deviation_rms_m").is_number(), timed);
    EXPECT_TRUE(trial.figures.at("force_error_rms_n").is_null()) << "a circle has no expert";
  }
  // The log and the paths are on the disk.
  EXPECT_EQ(trials(load_session_log(options_.folder)), trials(result.log));
  for (const std::string& path : result.log.paths) EXPECT_EQ(load_path(file(path)).size(), 1501U);
}

TEST_F(ProgrammeSession, ResistsTheParticipantAndHelpsWhenItAssists) {
  const ProgrammeResult result = run(
      programme_of({R"("mode": "resist", "resistance": 8)", R"("mode": "assisted", "pace": 3, "assist_force": 3)"}));
  ASSERT_EQ(result.log.trials.size(), 2U);
  const json& resisted = result.log.trials[0].figures;
  EXPECT_GT(resisted.at("resist_work_j").get<double>(), 5 * resisted.at("assist_work_j").get<double>());
  EXPECT_GT(resisted.at("resist_work_j").get<double>(), 0.04) << "some 0.08 m/s against 8 N s/m, for 0.13 m";
  const json& helped = result.log.trials[1].figures;
  EXPECT_GT(helped.at("assist_work_j").get<double>(), helped.at("resist_work_j").get<double>());
}

TEST_F(ProgrammeSession, ResumesWithTheRepetitionThatWasInterrupted) {
  const json programme =
      programme_of({R"("mode": "tunnel", "repetitions": 3)", R"("mode": "free", "repetitions": 2)"}, R"("rounds": 2,)");
  options_.begins = [&](const ScheduledTrial& trial, const TrialSettings&, std::size_t, std::size_t) {
    if (trial.round == 1 && trial.exercise == 1 && trial.repetition == 1) (*stop_).raise();
  };
  const ProgrammeResult first = run(programme);
  EXPECT_FALSE(first.log.complete);
  EXPECT_EQ(first.log.sittings.back().ended_by, "interrupted");
  EXPECT_THAT(trials(first.log), testing::ElementsAre("0.1.1.1", "0.1.2.1", "0.1.3.1", "1.1.1.1!"));
  EXPECT_EQ(first.last->servo.cause, StopCause::interrupted);

  options_.begins = nullptr;
  const ProgrammeResult second = resume();
  EXPECT_TRUE(second.log.complete);
  EXPECT_THAT(trials(second.log),
              testing::ElementsAre("0.1.1.1", "0.1.2.1", "0.1.3.1", "1.1.1.1!", "1.1.1.2", "1.1.2.1", "0.2.1.1",
                                   "0.2.2.1", "0.2.3.1", "1.2.1.1", "1.2.2.1"));
  EXPECT_EQ(second.log.sittings.size(), 2U);
  EXPECT_EQ(second.log.sittings[1].first_trial, 4U);
  EXPECT_NE(second.log.trials[3].file, second.log.trials[4].file) << "the recording of the first attempt is kept";
  EXPECT_TRUE(std::filesystem::exists(file(second.log.trials[3].file)));
}

TEST_F(ProgrammeSession, LogsNoSittingThatWasRefusedAtItsStart) {
  options_.begins = [&](const ScheduledTrial& trial, const TrialSettings&, std::size_t, std::size_t) {
    if (trial.repetition == 2) (*stop_).raise();
  };
  (void)run(programme_of({R"("mode": "free", "repetitions": 3)"}));
  const SessionLog before = load_session_log(options_.folder);
  options_.begins = nullptr;
  const double rate = std::exchange(options_.session.loop.rate_hz, 1e5);
  EXPECT_THAT(test::error_of([&] { (void)resume(); }), HasSubstr("100000 Hz"));
  const SessionLog after = load_session_log(options_.folder);
  EXPECT_EQ(after.sittings.size(), before.sittings.size());
  EXPECT_EQ(after.trials.size(), before.trials.size());
  options_.session.loop.rate_hz = rate;
  EXPECT_TRUE(resume().log.complete);
}

TEST_F(ProgrammeSession, LogsWhatStoppedIt) {
  options_.begins = [&](const ScheduledTrial& trial, const TrialSettings&, std::size_t, std::size_t) {
    if (trial.repetition == 2) (*stop_).raise(StopSource::page);
  };
  const ProgrammeResult within = run(programme_of({R"("mode": "free", "repetitions": 3)"}));
  EXPECT_EQ(within.log.sittings.back().ended_by, "interrupted");
  EXPECT_EQ(load_session_log(options_.folder).sittings.back().stopped_from, "page");
  EXPECT_THAT(within.log.sittings.back().detail, HasSubstr("by a page of the view"));
  EXPECT_EQ(to_json(within)["sitting"]["stopped_from"], "page");
  EXPECT_EQ(to_json(within)["trials"][0]["unattended"], false);

  options_.begins = nullptr;
  options_.ended = [&](const LoggedTrial&) { (*stop_).raise(StopSource::command); };
  const ProgrammeResult between = resume();
  EXPECT_EQ(between.log.sittings.back().ended_by, "interrupted");
  EXPECT_EQ(between.log.sittings.back().stopped_from, "command");
}

TEST_F(ProgrammeSession, LosesOnlyTheRepetitionInWhichAProcessDied) {
  const json programme = programme_of({R"("mode": "tunnel", "repetitions": 3)"});
  (void)run(programme);
  // The log as a process leaves it that dies in the second repetition.
  SessionLog log = load_session_log(options_.folder);
  log.trials.resize(2);
  log.trials[1] = {.exercise = 0, .repetition = 2, .file = log.trials[1].file};
  log.complete = false;
  log.sittings[0].ended = log.sittings[0].ended_by = "";
  std::filesystem::remove(file("01-exercise-1-01-003.h5"));
  save_session_log(log, options_.folder);

  const ProgrammeResult result = resume();
  EXPECT_THAT(trials(result.log), testing::ElementsAre("0.1.1.1", "0.1.2.1!", "0.1.2.2", "0.1.3.1"));
  EXPECT_TRUE(result.log.complete);
}

TEST_F(ProgrammeSession, AdaptsAsItWouldHaveWithoutAnInterruption) {
  const json programme = programme_of({R"("mode": "assisted", "repetitions": 6, "progression": {"target": 0.004,
      "window": 2, "assistance": {"forget": 0.6, "gain": 0.2},
      "difficulty": {"step": 0.5, "radius": {"easy": 0.01, "hard": 0.004}}})"});
  const auto settings = [](const SessionLog& log) {
    std::vector<std::pair<double, double>> all;
    for (const LoggedTrial& trial : log.trials)
      if (trial.finished()) all.emplace_back(trial.settings.assistance, trial.settings.radius);
    return all;
  };
  const std::vector<std::pair<double, double>> whole = settings(run(programme).log);
  ASSERT_EQ(whole.size(), 6U);
  EXPECT_EQ(whole[0].first, 1);
  EXPECT_LT(whole[5].first, 0.2) << "the hand follows well: help fades";
  EXPECT_NEAR(whole[5].second, 4e-3, 1e-12);

  std::filesystem::remove_all(options_.folder);
  opened_ = 0;
  options_.begins = [&](const ScheduledTrial& trial, const TrialSettings&, std::size_t, std::size_t) {
    if (trial.repetition == 4) (*stop_).raise();
  };
  (void)run(programme);
  options_.begins = nullptr;
  --opened_;  // the repeated repetition uses the same hand
  EXPECT_EQ(settings(resume().log), whole);
}

TEST_F(ProgrammeSession, ScalesTheStiffnessOfWallsWithTheAssistance) {
  const ProgrammeResult result = run(programme_of({R"("mode": "assisted", "stiffness": 100, "repetitions": 9,
      "progression": {"target": 1, "assistance": {"forget": 0.5, "gain": 0}})"}));
  double share = 1;
  for (const LoggedTrial& trial : result.log.trials) {
    const json config = RecordingReader(file(trial.file)).header().config;
    if (share > 0.01) {
      EXPECT_NEAR(config.at("stiffness").get<double>(), 100 * share, 1e-9);
    } else {
      EXPECT_EQ(config.at("mode"), "free") << "nothing at all in the end";
    }
    share *= 0.5;
  }
}

TEST_F(ProgrammeSession, DoesNotLimitTheDeviationInAFreeExercise) {
  options_.max_deviation = 0.1;  // applies only to the approach
  options_.open = [this](const Exercise&, const TrialSettings&, const std::string& path) -> std::shared_ptr<Device> {
    Path beside = load_path(path);
    for (Vec3& p : beside.position) p *= 0.5;
    save_path(beside, temp_ / "beside.csv", "beside", true);
    return open_device("sim:preset=omega3,hand=firm,intent=" + (temp_ / "beside.csv"));
  };
  EXPECT_TRUE(run(programme_of({R"("mode": "free", "time_limit": 2)"})).log.complete);
}

TEST_F(ProgrammeSession, CountsARepetitionThatRanOutOfTimeAsDoneAndFailed) {
  options_.open = [](const Exercise&, const TrialSettings&, const std::string&) -> std::shared_ptr<Device> {
    return open_device("sim:preset=omega3,hand=relaxed");  // a hand without intent
  };
  const ProgrammeResult result = run(programme_of({R"("mode": "assisted", "repetitions": 3, "assist_force": 0,
      "time_limit": 1, "progression": {"target": 0.008, "assistance": {"start": 0.5, "forget": 0.8, "gain": 0.4}})"}));
  EXPECT_TRUE(result.log.complete) << "a target that was missed does not repeat the trial";
  ASSERT_EQ(result.log.trials.size(), 3U);
  for (const LoggedTrial& trial : result.log.trials) {
    EXPECT_EQ(trial.stopped_by, "time_over");
    EXPECT_TRUE(trial.partial());
    EXPECT_LT(trial.figures.at("completion").get<double>(), 0.5) << "the share of the path";
    EXPECT_LT(trial.figures.at("contour_rms_m").get<double>(), 0.008) << "the hand is near the path, but not on it";
  }
  EXPECT_NEAR(result.log.trials[1].settings.assistance, 0.8 * 0.5 + 0.4, 1e-12);
  EXPECT_NEAR(result.log.trials[2].settings.assistance, 1, 1e-12);
}

TEST_F(ProgrammeSession, LogsWhoBeganEachRepetitionWithABackWall) {
  options_.open = [](const Exercise&, const TrialSettings&, const std::string&) -> std::shared_ptr<Device> {
    return open_device("sim:preset=omega3,hand=relaxed,seed=2");  // a hand without intent
  };
  const ProgrammeResult result = run(
      programme_of({R"("mode": "assisted", "assist_force": 0, "time_limit": 4, "initiate": {"wait": 1, "force": 1.5})",
                    R"("mode": "tunnel", "time_limit": 1)"}));
  const SessionLog log = load_session_log(options_.folder);
  ASSERT_EQ(log.trials.size(), 2U);
  ASSERT_TRUE(log.trials[0].initiation);
  EXPECT_EQ(log.trials[0].initiation->initiator, Initiator::helped);
  EXPECT_GT(log.trials[0].initiation->waited, 1);
  EXPECT_GT(log.trials[0].initiation->work, 0);
  EXPECT_GT(log.trials[0].figures.at("helped_time").get<double>(), 0.3);
  EXPECT_FALSE(log.trials[1].initiation);
  EXPECT_EQ(to_json(result)["trials"][0]["initiation"]["initiator"], "helped");
  EXPECT_EQ(to_json(result)["trials"][1]["partial"], true);
}

TEST_F(ProgrammeSession, LogsTheStiffnessThatTheWallsHad) {
  const ProgrammeResult result =
      run(programme_of({R"("mode": "tunnel")", R"("mode": "free")", R"("mode": "passive")"}));
  EXPECT_GT(result.log.trials.at(0).settings.stiffness.value_or(0), 50);
  EXPECT_FALSE(result.log.trials.at(1).settings.stiffness);
  EXPECT_FALSE(result.log.trials.at(2).settings.stiffness);
}

TEST_F(ProgrammeSession, LogsWhyItFailed) {
  int begun = 0;
  options_.open = [&](const Exercise&, const TrialSettings&, const std::string& path) -> std::shared_ptr<Device> {
    // An invalid compression level makes the recording of the second repetition fail.
    if (++begun == 2) options_.session.recording->options.storage.deflate = 99;
    return open_device("sim:preset=omega3,hand=relaxed,intent=" + path);
  };
  EXPECT_NE(error_of([&] { (void)run(programme_of({R"("mode": "tunnel", "repetitions": 3)"})); }), "no error");
  const SessionLog log = load_session_log(options_.folder);
  ASSERT_EQ(log.trials.size(), 2U);
  EXPECT_EQ(log.trials[1].stopped_by, "fault");
  EXPECT_NE(log.trials[1].detail, "");
  EXPECT_EQ(log.sittings.back().detail, log.trials[1].detail);
  EXPECT_EQ(log.sittings.back().ended_by, "stopped");
}

TEST_F(ProgrammeSession, LetsNoCommandReachARepetitionThatFailed) {
  LiveGuidance live({.programme = true});
  options_.live = &live;
  options_.open = [&](const Exercise&, const TrialSettings&, const std::string& path) -> std::shared_ptr<Device> {
    options_.session.recording->options.storage.deflate = 99;  // the recording fails
    return open_device("sim:preset=omega3,hand=relaxed,intent=" + path);
  };
  EXPECT_NE(error_of([&] { (void)run(programme_of({R"("mode": "tunnel")"})); }), "no error");
  EXPECT_EQ(live.obey("skip"), "error skip: no repetition is running");
}

TEST_F(ProgrammeSession, LeavesNoFilesOfASessionThatCouldNotStart) {
  const json programme = programme_of({R"("mode": "free")"});
  const auto device = open_device("sim:preset=omega3");
  ProgrammePlan plan = plan_programme(programme_from_json(programme, "p.json"), ".", "p.json", &device->info(), false);
  plan.paths[0].time.back() = 0;  // the path is invalid now
  EXPECT_NE(error_of([&] { (void)begin_session(programme, "p.json", plan, device->info(), options_); }), "no error");
  EXPECT_FALSE(std::filesystem::exists(options_.folder));
}

TEST_F(ProgrammeSession, StartsEverySittingWithTheWarmUp) {
  const json programme = programme_of({R"("mode": "tunnel", "repetitions": 2)"},
                                      fmt::format(R"("warm_up": [{{{}, "mode": "passive"}}],)", kShape));
  options_.begins = [&](const ScheduledTrial& trial, const TrialSettings&, std::size_t, std::size_t) {
    if (trial.exercise == 1 && trial.repetition == 2) (*stop_).raise();
  };
  (void)run(programme);
  options_.begins = nullptr;
  EXPECT_THAT(trials(resume().log), testing::ElementsAre("0.1.1.1", "1.1.1.1", "1.1.2.1!", "0.2.1.1", "1.1.2.2"));
}

TEST_F(ProgrammeSession, EndsASittingWhenItsTimeIsOver) {
  const ProgrammeResult result =
      run(programme_of({R"("mode": "tunnel", "repetitions": 50)"}, R"("limits": {"time": 20},)"));
  EXPECT_FALSE(result.log.complete);
  EXPECT_EQ(result.log.sittings[0].ended_by, "time");
  EXPECT_GT(result.log.trials.size(), 3U);
  EXPECT_LT(result.log.trials.size(), 8U);
  EXPECT_LE(result.log.sittings[0].duration, 20);
  EXPECT_GT(result.log.sittings[0].duration, 12);
}

TEST_F(ProgrammeSession, EndsASittingAtOnceWhenTheForceDoseIsReached) {
  const json programme =
      programme_of({R"("mode": "resist", "resistance": 10, "repetitions": 50)"}, R"("limits": {"force_dose": 5},)");
  const ProgrammeResult result = run(programme);
  const Sitting& sitting = result.log.sittings[0];
  EXPECT_EQ(sitting.ended_by, "force_dose");
  EXPECT_GE(sitting.force_dose, 5);
  EXPECT_LT(sitting.force_dose, 5.4) << "only the release of the last force is beyond it";
  double sum = 0;
  for (const LoggedTrial& trial : result.log.trials) sum += trial.force_dose;
  EXPECT_NEAR(sum, sitting.force_dose, 1e-9);
  // The dose is the integral of the sent force; rows are 1 ms apart.
  const LoggedTrial& first = result.log.trials[0];
  double recorded = 0;
  for (const Sample& sample : RecordingReader(file(first.file)).read(0, 1'000'000))
    recorded += 1e-3 * sample.force.norm();
  EXPECT_NEAR(first.force_dose, recorded, 0.01 * recorded);

  // The repetition says why it ended, in the log and in its recording, and is repeated in the next sitting.
  const LoggedTrial& last = result.log.trials.back();
  EXPECT_EQ(last.stopped_by, "force_dose");
  EXPECT_FALSE(last.done());
  EXPECT_THAT(last.notices, testing::Contains(HasSubstr("the force dose of the sitting reached 5 N s")));
  EXPECT_THAT(RecordingReader(file(last.file)).header().warnings.dump(), HasSubstr("reached 5 N s"));
  const SessionLog resumed = resume().log;
  const LoggedTrial& again = resumed.trials.at(result.log.trials.size());
  EXPECT_EQ(again.repetition, last.repetition);
  EXPECT_EQ(again.attempt, 2);
}

TEST_F(ProgrammeSession, KeepsARandomOrderInItsLogAndResumesInIt) {
  const json programme = programme_of({R"("mode": "free", "repetitions": 3)", R"("mode": "free", "repetitions": 3)"},
                                      R"("order": "interleaved", "rounds": 2,)");
  int begun = 0;
  options_.begins = [&](const ScheduledTrial&, const TrialSettings&, std::size_t, std::size_t) {
    if (++begun == 4) (*stop_).raise();
  };
  (void)run(programme);
  options_.begins = nullptr;
  SessionLog log = load_session_log(options_.folder);
  EXPECT_TRUE(log.programme.contains("seed")) << "drawn, and kept";
  EXPECT_THAT(log.generator, HasSubstr("mt19937_64"));
  ASSERT_EQ(log.schedule.size(), 12U);
  // The log rules, not the seed: another version may draw another order.
  std::swap(log.schedule[6], log.schedule[8]);
  save_session_log(log, options_.folder);
  const SessionLog resumed = resume().log;
  std::vector<PlannedTrial> done;
  for (const LoggedTrial& trial : resumed.trials)
    if (trial.done()) done.push_back({trial.exercise, trial.round, trial.repetition});
  EXPECT_EQ(done, log.schedule);
}

TEST_F(ProgrammeSession, HasNoTunnelInFreeExercisesThatDoNotAskForOne) {
  const SessionLog log =
      run(programme_of({R"("mode": "free")", R"("mode": "free", "radius": 0.004)",
                        R"("mode": "free", "show": {"tunnel": 0.5})", R"("mode": "free", "show": {"score": "always"})",
                        R"("mode": "free", "show": {"tunnel": "never"})"}))
          .log;
  const std::vector<bool> asked{false, true, true, true, false};
  ASSERT_EQ(log.trials.size(), asked.size());
  for (std::size_t i = 0; i < asked.size(); ++i) {
    SCOPED_TRACE(i);
    const RecordingReader reader(file(log.trials[i].file));
    EXPECT_EQ(reader.columns().tunnel, asked[i]);
    EXPECT_EQ(log.trials[i].figures.at("time_in_tunnel").is_number(), asked[i]);
    EXPECT_EQ(reader.header().config.contains("radius"), asked[i]);
    EXPECT_TRUE(log.trials[i].figures.at("contour_rms_m").is_number()) << "the path is still followed";
  }
}

TEST_F(ProgrammeSession, EndsASittingWhenTheParticipantIsTired) {
  // The path stays the same, and the hand becomes slower from the third repetition on.
  options_.open = [this](const Exercise&, const TrialSettings&, const std::string& path) -> std::shared_ptr<Device> {
    ++opened_;
    Path slow = load_path(path);
    const double times = opened_ < 3 ? 1 : 2;
    for (double& t : slow.time) t *= times;
    for (Vec3& v : slow.velocity) v /= times;
    const std::string intent = temp_ / fmt::format("intent-{}.csv", opened_);
    save_path(slow, intent, "intent", true);
    return open_device(fmt::format("sim:preset=omega3,hand=firm,seed=1,intent={}", intent));
  };
  const ProgrammeResult result =
      run(programme_of({R"("mode": "tunnel", "repetitions": 20)"},
                       R"("limits": {"fatigue": {"figure": "movement_time_s", "worse": 0.3, "repetitions": 3}},)"));
  EXPECT_EQ(result.log.sittings[0].ended_by, "fatigue");
  EXPECT_EQ(result.log.trials.size(), 5U) << "two that were good, and three that were not";
  EXPECT_THAT(result.log.sittings[0].detail, HasSubstr("'exercise 1'"));
}

TEST_F(ProgrammeSession, StopsWithTheDataWhenADeviceIsLost) {
  std::shared_ptr<PointMass> device = std::make_shared<PointMass>(0.5, 2, PointMass::Faults{.lost_at = 2000});
  options_.open = [&](const Exercise&, const TrialSettings&, const std::string&) { return device; };
  const json programme = programme_of({R"("mode": "passive", "repetitions": 5)"});
  const Programme read = programme_from_json(programme, "p.json");
  const ProgrammePlan plan = plan_programme(read, temp_.path(), "p.json", &device->info(), false);
  (void)begin_session(programme, "p.json", plan, device->info(), options_);
  const ProgrammeResult result = run_programme(options_, stop_);
  EXPECT_EQ(result.last->servo.cause, StopCause::device_lost);
  EXPECT_EQ(result.log.sittings[0].ended_by, "stopped");
  ASSERT_EQ(result.log.trials.size(), 1U);
  EXPECT_EQ(result.log.trials[0].stopped_by, "device_lost");
  EXPECT_TRUE(result.log.trials[0].figures.is_null());
  EXPECT_GT(RecordingReader(file(result.log.trials[0].file)).rows(), 1900U);

  device = std::make_shared<PointMass>();
  EXPECT_TRUE(resume().log.complete);
}

TEST_F(ProgrammeSession, RefusesToResumeWithAnotherDevice) {
  options_.begins = [&](const ScheduledTrial&, const TrialSettings&, std::size_t, std::size_t) { (*stop_).raise(); };
  (void)run(programme_of({R"("mode": "tunnel")"}));
  options_.begins = nullptr;
  const std::size_t before = load_session_log(options_.folder).trials.size();
  options_.open = [](const Exercise&, const TrialSettings&, const std::string&) {
    return std::make_shared<PointMass>();
  };
  EXPECT_THAT(error_of([&] { (void)resume(); }), AllOf(HasSubstr("started with sim"), HasSubstr("point mass")));
  const SessionLog log = load_session_log(options_.folder);
  EXPECT_EQ(log.sittings.size(), 1U);
  EXPECT_EQ(log.trials.size(), before) << "nothing was begun";
}

TEST_F(ProgrammeSession, SkipsARepetitionAndGoesOnWithTheNext) {
  LiveGuidance live({.programme = true});
  options_.live = &live;
  EXPECT_EQ(live.obey("skip"), "error skip: no repetition is running");
  const auto open = options_.open;
  options_.open = [&, first = true](const Exercise& exercise, const TrialSettings& settings,
                                    const std::string& path) mutable -> std::shared_ptr<Device> {
    const auto device = open(exercise, settings, path);
    if (!std::exchange(first, false)) return device;
    return std::make_shared<CommandingDevice>(device, [&] { (void)live.obey("skip"); });
  };
  const SessionLog log = run(programme_of({R"("mode": "free", "repetitions": 2)"})).log;
  EXPECT_TRUE(log.complete);
  ASSERT_EQ(log.trials.size(), 2U);
  EXPECT_EQ(log.trials[0].stopped_by, "skipped");
  EXPECT_TRUE(log.trials[0].figures.is_null());
  EXPECT_TRUE(log.trials[1].finished());
  EXPECT_TRUE(load_session_log(options_.folder).trials[0].skipped());
}

TEST_F(ProgrammeSession, KeepsTheSupportOfTheArmThatACommandSetForTheExercise) {
  LiveGuidance live({.programme = true});
  options_.live = &live;
  std::vector<std::string> answers;
  options_.ended = [&](const LoggedTrial& trial) {
    answers.push_back(live.obey(trial.repetition == 1 ? "support 0" : "support 0.5"));
  };
  const SessionLog log = run(programme_of({R"("mode": "free", "repetitions": 3, "support": 1)"})).log;
  ASSERT_EQ(log.trials.size(), 3U);
  EXPECT_EQ(answers[0], "ok support 0");
  EXPECT_EQ(log.trials[0].settings.support, 1);
  EXPECT_EQ(log.trials[1].settings.support, 0);
  EXPECT_EQ(log.trials[2].settings.support, 0.5) << "it was off, and a command raised it again";
}

TEST_F(ProgrammeSession, RepeatsARepetitionOnceMoreAfterIt) {
  LiveGuidance live({.programme = true});
  options_.live = &live;
  std::vector<std::string> order;
  options_.begins = [&](const ScheduledTrial& trial, const TrialSettings&, std::size_t number, std::size_t of) {
    order.push_back(fmt::format("{}:{}/{}", trial.repetition, number, of));
  };
  options_.ended = [&](const LoggedTrial& trial) {
    if (trial.repetition == 1 && trial.attempt == 1) {
      EXPECT_EQ(live.obey("repeat"), "ok repeat: once more after this repetition");
    }
  };
  const SessionLog log = run(programme_of({R"("mode": "free", "repetitions": 2)"})).log;
  EXPECT_TRUE(log.complete);
  EXPECT_THAT(order, testing::ElementsAre("1:1/2", "1:2/3", "2:3/3"));
  EXPECT_THAT(trials(log), testing::ElementsAre("0.1.1.1", "0.1.1.2", "0.1.2.1"));
}

TEST_F(ProgrammeSession, RepeatsARepetitionThatIsAskedForInThePauseAfterIt) {
  LiveGuidance live({.programme = true});
  options_.live = &live;
  std::vector<int> order;
  options_.begins = [&](const ScheduledTrial& trial, const TrialSettings&, std::size_t, std::size_t) {
    order.push_back(trial.repetition);
    if (order.size() == 1) (void)live.obey("pause");
  };
  options_.rests = [&](double) {
    EXPECT_EQ(live.obey("repeat"), "ok repeat: once more after this repetition");
    EXPECT_EQ(live.obey("resume"), "ok resume");
  };
  EXPECT_TRUE(run(programme_of({R"("mode": "free", "repetitions": 2)"})).log.complete);
  EXPECT_THAT(order, testing::ElementsAre(1, 1, 2));
}

TEST_F(ProgrammeSession, KeepsAChangedTunnelForTheExerciseAndLogsIt) {
  LiveGuidance live({.programme = true});
  options_.live = &live;
  std::string answer;
  options_.ended = [&](const LoggedTrial& trial) {
    if (trial.exercise == 0 && trial.repetition == 1) answer = live.obey("radius 8mm");
  };
  const SessionLog log = run(programme_of({R"("mode": "tunnel", "radius": 0.005, "repetitions": 2)",
                                           R"("mode": "tunnel", "radius": 0.005)"}))
                             .log;
  EXPECT_EQ(answer, "ok radius 8mm");
  ASSERT_EQ(log.trials.size(), 3U);
  EXPECT_NEAR(log.trials[0].settings.radius, 0.005, 1e-9);
  EXPECT_NEAR(log.trials[1].settings.radius, 0.008, 1e-9);
  EXPECT_NEAR(log.trials[2].settings.radius, 0.005, 1e-9) << "another exercise";
  const std::string recording = file(log.trials[1].file);
  EXPECT_NEAR(read_trials(RecordingReader(recording), recording).back().radius.front(), 0.008, 1e-5)
      << "in force from the start";
  EXPECT_EQ(live.history()["changes"][0]["recording"], log.trials[0].file);
}

TEST_F(ProgrammeSession, AnnouncesTheValuesThatCommandsSetAndNotThoseOfTheProgramme) {
  LiveGuidance live({.programme = true});
  options_.live = &live;
  std::vector<TrialSettings> announced;
  options_.begins = [&](const ScheduledTrial&, const TrialSettings& settings, std::size_t, std::size_t) {
    announced.push_back(settings);
  };
  options_.ended = [&](const LoggedTrial& trial) {
    if (trial.exercise > 0) return;
    EXPECT_EQ(live.obey("radius 8mm"), "ok radius 8mm");
    EXPECT_EQ(live.obey("assist 0.4"), "ok assist 0.4");
    if (trial.repetition == 2) {
      EXPECT_THAT(live.obey("reset"), testing::StartsWith("ok reset"));
    }
  };
  EXPECT_TRUE(run(programme_of({R"("mode": "assisted", "radius": 0.005, "repetitions": 3)",
                                R"("mode": "assisted", "radius": 0.005)"}))
                  .log.complete);
  ASSERT_EQ(announced.size(), 4U);
  EXPECT_EQ(announced[0].radius, 0.005);
  EXPECT_EQ(announced[0].assistance, 1);
  EXPECT_EQ(announced[1].radius, 0.008);
  EXPECT_EQ(announced[1].assistance, 0.4);
  EXPECT_EQ(announced[2].radius, 0.005) << "after a reset";
  EXPECT_EQ(announced[3].radius, 0.005) << "another exercise";
  EXPECT_EQ(announced[3].assistance, 1);
}

TEST_F(ProgrammeSession, LogsWhatEachRepetitionShowedAndAnnouncesIt) {
  std::vector<TrainingTrial> announced;
  options_.announces = [&](const TrainingTrial& trial) { announced.push_back(trial); };
  const SessionLog log =
      run(programme_of(
              {R"("mode": "free", "name": "Test", "test": "before")",
               R"("mode": "free", "name": "Curve", "repetitions": 2, "show": {"score": 0.5, "trail": "always"})"}))
          .log;
  const SessionLog read = load_session_log(options_.folder);
  ASSERT_EQ(announced.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(read.trials[i].shown, announced[i].show) << i;
  const auto score = static_cast<std::size_t>(ScreenPart::score), trail = static_cast<std::size_t>(ScreenPart::trail);
  EXPECT_FALSE(announced[0].show[trail]) << "a test";
  EXPECT_TRUE(announced[1].show[trail]);
  EXPECT_NE(announced[1].show[score], announced[2].show[score]) << "every other one";
  EXPECT_EQ(announced[0].next, "Curve");
  EXPECT_EQ(announced[2].next, "");
  EXPECT_EQ(announced[2].number, 3U);
}

TEST_F(ProgrammeSession, WaitsWhileItIsPaused) {
  LiveGuidance live({.programme = true});
  options_.live = &live;
  int waited = 0;
  std::size_t begun = 0;
  options_.begins = [&](const ScheduledTrial&, const TrialSettings&, std::size_t, std::size_t) {
    if (++begun == 1) {
      EXPECT_EQ(live.obey("pause"), "ok pause");
    }
  };
  options_.rests = [&](double left) {
    EXPECT_TRUE(std::isnan(left)) << "in virtual time rests take no time";
    EXPECT_EQ(begun, 1U);
    if (++waited == 3) {
      EXPECT_EQ(live.obey("resume"), "ok resume");
    }
  };
  EXPECT_TRUE(run(programme_of({R"("mode": "free", "repetitions": 2)"})).log.complete);
  EXPECT_EQ(waited, 3);
}

TEST_F(ProgrammeSession, NeverWritesIntoAFolderThatHoldsSomething) {
  const json programme = programme_of({R"("mode": "free")"});
  (void)run(programme);
  EXPECT_THAT(error_of([&] { (void)run(programme); }),
              AllOf(HasSubstr("already contains a session"), HasSubstr("is complete; choose another folder")));
  SessionLog log = load_session_log(options_.folder);
  log.complete = false;
  save_session_log(log, options_.folder);
  EXPECT_THAT(error_of([&] { (void)run(programme); }), HasSubstr("resume it (haptrace run --resume "));
  options_.folder = temp_ / "other";
  std::filesystem::create_directory(options_.folder);
  (void)temp_.write("other/notes.txt", "mine");
  EXPECT_THAT(error_of([&] { (void)run(programme); }), HasSubstr("not an empty folder"));
  EXPECT_EQ(test::read_bytes(temp_ / "other/notes.txt"), "mine");
}

TEST(ProgrammePlan, CountsTrialsAndTheirDuration) {
  const json programme = programme_of({R"("mode": "tunnel", "repetitions": 3, "rest_after": 7)", R"("mode": "free")"},
                                      fmt::format(R"("rounds": 2, "warm_up": [{{{}, "mode": "free"}}],)", kShape));
  const Programme read = programme_from_json(programme, "p.json");
  const ProgrammePlan plan = plan_programme(read, ".", "p.json", nullptr, false);
  ASSERT_EQ(plan.trials.size(), 9U);
  EXPECT_EQ(plan.trials[0].exercise, 0U);
  EXPECT_EQ(plan.trials[3].rest, 8);
  EXPECT_EQ(plan.trials.back().rest, 0);
  EXPECT_NEAR(plan.parts[1].path_length, std::numbers::pi * 0.04, 1e-4);
  // Each trial: 0.5 s approach, 1.5 s path, 0.5 s hold. Rests: 11 s (1 + 1 + 8 + 1) per round, 2 s after the warm-up,
  // none after the last trial.
  EXPECT_NEAR(plan.duration, 9 * 2.5 + 2 * 11 + 2 - 1, 1e-6);
}

TEST(ProgrammePlan, RejectsAProgrammeThatCannotBeCompleted) {
  const auto error = [](const json& programme) {
    return error_of(
        [&] { (void)plan_programme(programme_from_json(programme, "p.json"), ".", "p.json", nullptr, false); });
  };
  EXPECT_THAT(
      error(programme_of({R"("mode": "free")"}, fmt::format(R"("limits": {{"time": 5}}, "warm_up": [{{{}, "mode":
                                                                    "passive"}}],)",
                                                            kShape))),
      HasSubstr("p.json: limits.time: 5 s are too short for the warm-up and one repetition"));
  const TempFolder folder;
  const std::string file = folder.write("point.csv", "t,x,y,z\n0,0,0,0\n");
  const json point = {{"haptrace_programme", 1}, {"exercises", {{{"path", file}, {"mode", "tunnel"}}}}};
  EXPECT_THAT(error(point), HasSubstr("has no length"));
}

TEST(ProgrammePlan, NamesThePathThatLeavesTheWorkspaceUnlessAllMayBeMoved) {
  const auto device = open_device("sim:preset=falcon");
  json programme = programme_of({R"("mode": "tunnel")", R"("mode": "tunnel")"});
  programme["exercises"][1]["shape"]["size"] = 0.4;
  const Programme read = programme_from_json(programme, "p.json");
  EXPECT_THAT(error_of([&] { (void)plan_programme(read, ".", "p.json", &device->info(), false); }),
              HasSubstr("leaves the workspace"));
  const ProgrammePlan plan = plan_programme(read, ".", "p.json", &device->info(), true);
  ASSERT_TRUE(plan.parts[0].fit);
  EXPECT_EQ(plan.parts[0].fit->scale, plan.parts[1].fit->scale)
      << "all alike, so that they stay where they are to each other";
  EXPECT_NEAR(plan.paths[0].bounds().size().x() / plan.paths[1].bounds().size().x(), 0.1, 1e-9);
}

}  // namespace
}  // namespace haptrace
