#include "formats/recording/recording.h"
#include "tests/support/temp_folder.h"
#include "tests/view/page_client.h"
#include "view/live_source.h"
#include "view/viewed_recording.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <memory>
#include <random>

namespace haptrace {
namespace {

using test::BinaryMessage;
using test::TempFolder;

constexpr RecordingColumns kAllColumns{
    .orientation = true, .force_measured = true, .reference = true, .guidance = true, .tunnel = true};

/// Returns rows of a movement with gaps, phases, and one row whose force is a spike.
std::vector<Sample> rows_of_movement(std::size_t count) {
  std::vector<Sample> rows(count);
  std::mt19937 random(5);
  std::uint64_t tick = 0;
  for (std::size_t i = 0; i < count; ++i, ++tick) {
    if (random() % 1000 == 0) tick += random() % 500;
    const double t = 1e-3 * static_cast<double>(tick);
    Sample& row = rows[i];
    row.tick = tick;
    row.time_ns = static_cast<std::int64_t>(tick) * 1'000'000 + 40'000;
    row.position = Vec3(0.05 * std::sin(t), 0.05 * std::cos(t), 0.01 * std::sin(3 * t));
    row.velocity = Vec3(0.05 * std::cos(t), 0, 0);
    row.force = Vec3(0, i == count / 3 ? 8 : 0.5, 0);
    row.phase = i < count / 10 ? Phase::approach : Phase::run;
    if (row.phase == Phase::run) {
      row.reference_position = row.position + Vec3(0, 0, 1e-3);
      row.reference_velocity = row.velocity;
      row.progress = 0.05 * t;
      row.tunnel_radius = 0.005;
      row.reference_force = Vec3(1, 0, 0);
    }
    row.orientation = Quat(1, 0, 0, 0);
    row.force_measured = Vec3(0, 0, 0.25);
  }
  return rows;
}

void write(const std::string& file, const std::vector<Sample>& rows) {
  RecordingHeader header;
  header.title = "a title";
  header.device_name = "sim:preset=falcon";
  header.config = {{"verb", "guide"}, {"mode", "tunnel"}, {"max-deviation", 0.1}};
  header.meta["input"] = "mouse, depth from path";
  RecordingWriter writer(file, header, kAllColumns, {});
  writer.append(rows);
  writer.append(StoredEvent{.time = 0.5, .code = static_cast<int>(EventCode::mark), .text = "here"});
  writer.append(StoredEvent{.time = 0.6, .code = static_cast<int>(EventCode::force_limit), .text = "limited"});
  writer.finish();
}

BinaryMessage message_of(const Frame& frame) {
  const auto header = frame_header(frame, 1, 0);
  return BinaryMessage(std::string(header.data(), header.size()) + frame.body);
}

/// Where a source comes from, for the laws of all sources.
struct SourceCase {
  const char* name;
  std::function<std::unique_ptr<ViewSource>(const std::string& file)> open;
};

std::unique_ptr<ViewSource> live_source(const std::string& file) {
  const RecordingReader reader(file);
  ViewedSession session;
  session.columns = reader.columns();
  auto source = std::make_unique<LiveSource>(session);
  for (const Sample& sample : reader.read(0, reader.rows())) {
    source->add(sample);
    if (sample.tick % 16 == 0) (void)source->take();
  }
  return source;
}

class EveryViewSource : public testing::TestWithParam<SourceCase> {
 protected:
  static constexpr std::size_t kCount = 150'000;

  static void SetUpTestSuite() {
    folder = std::make_unique<TempFolder>();
    rows = rows_of_movement(kCount);
    write(*folder / "movement.h5", rows);
  }
  static void TearDownTestSuite() {
    folder.reset();
    rows.clear();
  }

  /// Returns the answer to a request; the exact one, where a coarse one comes first.
  BinaryMessage ask(const ViewRequest& request) {
    std::optional<BinaryMessage> answer;
    do source->ask(request, [&](const Frame& frame) { answer = message_of(frame); });
    while ((answer->flags & FrameFlags::kCoarse) != 0 && work());
    EXPECT_EQ(answer->request, request.id);
    EXPECT_EQ(answer->flags & FrameFlags::kCoarse, 0);
    return *answer;
  }

  bool work() {
    auto* recording = dynamic_cast<ViewedRecording*>(source.get());
    return recording != nullptr && recording->work();
  }

  static inline std::unique_ptr<TempFolder> folder;
  static inline std::vector<Sample> rows;
  std::unique_ptr<ViewSource> source = GetParam().open(*folder / "movement.h5");
  ViewChannels channels{kAllColumns};
};

TEST_P(EveryViewSource, ItsRowsEqualTheRecordedOnesInSinglePrecision) {
  for (const auto& [t0, t1] : {std::pair(-1.0, 5.0), std::pair(64.0, 70.0), std::pair(100.0, 100.0005)}) {
    const BinaryMessage answer = ask({.kind = ViewRequest::Kind::rows, .id = 9, .t0 = t0, .t1 = t1});
    EXPECT_EQ(answer.kind, 1);
    EXPECT_EQ(answer.flags, 0);
    std::vector<Sample> expected;
    for (const Sample& row : rows)
      if (row.time_ns >= std::llround(1e9 * t0) && row.time_ns <= std::llround(1e9 * t1)) expected.push_back(row);
    ASSERT_EQ(answer.rows, expected.size());
    ASSERT_GT(answer.rows, 0U);
    std::vector<std::vector<float>> planes;
    for (std::size_t i = 0; i <= channels.size(); ++i) planes.push_back(answer.plane(i));
    std::vector<float> values(channels.size());
    for (std::size_t row = 0; row < expected.size(); ++row) {
      ASSERT_NEAR(answer.t0 + static_cast<double>(planes[0][row]), 1e-9 * static_cast<double>(expected[row].time_ns),
                  1e-6);
      channels.fill(expected[row], values);
      for (std::size_t i = 0; i < values.size(); ++i)
        ASSERT_TRUE(planes[i + 1][row] == values[i] || (std::isnan(values[i]) && std::isnan(planes[i + 1][row])))
            << channels[i].name << " of row " << row;
    }
  }
}

TEST_P(EveryViewSource, AnAnswerHasAtMost20000RowsAndSaysWhenItIsCutOff) {
  const BinaryMessage answer = ask({.kind = ViewRequest::Kind::rows, .id = 1, .t0 = 0, .t1 = 1000});
  EXPECT_EQ(answer.rows, 20'000U);
  EXPECT_NE(answer.flags & FrameFlags::kCut, 0);
  EXPECT_NEAR(answer.t0, 1e-9 * static_cast<double>(rows.front().time_ns), 1e-9);
}

TEST_P(EveryViewSource, ItsBinsHoldTheExtremesOfTheirRowsAtEveryZoom) {
  const std::size_t force = *channels.find("force"), x = *channels.find("x"), progress = *channels.find("progress");
  std::mt19937 random(3);
  const double end = 1e-9 * static_cast<double>(rows.back().time_ns);
  std::uniform_real_distribution<double> times(0, end);
  for (int round = 0; round < 30; ++round) {
    const double a = times(random), b = round < 3 ? a + 0.05 : times(random);
    const ViewRequest request{.id = 4,
                              .t0 = std::min(a, b),
                              .t1 = std::max(a, b),
                              .pixels = static_cast<std::uint32_t>(1 + random() % 300),
                              .channels = {force, x, progress}};
    const BinaryMessage answer = ask(request);
    ASSERT_EQ(answer.kind, 3);
    const test::DecodedBins bins = test::decode_bins(answer);
    const std::int64_t width = std::llround(1e9 * bins.width), first = std::llround(1e9 * answer.t0);
    EXPECT_EQ(first % width, 0);
    EXPECT_LE(answer.rows, request.pixels + 2);
    EXPECT_TRUE(width == 1'000'000 || bins.width * request.pixels * 0.5 <= request.t1 - request.t0 + 0.002);
    std::vector<std::vector<float>> expected_min(3), expected_max(3);
    for (std::size_t i = 0; i < 3; ++i) {
      expected_min[i].assign(answer.rows, std::numeric_limits<float>::quiet_NaN());
      expected_max[i] = expected_min[i];
    }
    std::vector<float> values(channels.size());
    for (const Sample& row : rows) {
      if (row.time_ns < first || row.time_ns >= first + width * answer.rows) continue;
      channels.fill(row, values);
      const auto k = static_cast<std::size_t>((row.time_ns - first) / width);
      for (std::size_t i = 0; i < 3; ++i) {
        expected_min[i][k] = std::fmin(expected_min[i][k], values[request.channels[i]]);
        expected_max[i][k] = std::fmax(expected_max[i][k], values[request.channels[i]]);
      }
    }
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_THAT(bins.channels[i].min, testing::Pointwise(testing::NanSensitiveFloatEq(), expected_min[i]));
      EXPECT_THAT(bins.channels[i].max, testing::Pointwise(testing::NanSensitiveFloatEq(), expected_max[i]));
    }
  }
}

TEST_P(EveryViewSource, AStretchBesideTheDataGivesNoRowsAndEmptyBins) {
  for (const double t : {-100.0, 1e6}) {
    const ViewRequest rows_request{.kind = ViewRequest::Kind::rows, .id = 2, .t0 = t, .t1 = t + 1};
    EXPECT_EQ(ask(rows_request).rows, 0U);
    const BinaryMessage answer = ask({.id = 3, .t0 = t, .t1 = t + 1, .pixels = 100, .channels = {0}});
    EXPECT_LE(answer.rows, 1U);
  }
  EXPECT_EQ(ask({.kind = ViewRequest::Kind::rows, .id = 2, .t0 = -8e9, .t1 = 8e9}).rows, 20'000U);
}

INSTANTIATE_TEST_SUITE_P(
    All, EveryViewSource,
    testing::Values(SourceCase{"LiveSession", live_source},
                    SourceCase{"Recording",
                               [](const std::string& file) { return std::make_unique<ViewedRecording>(file); }},
                    SourceCase{"RecordingThatIsNotBuilt",
                               [](const std::string& file) {
                                 return std::make_unique<ViewedRecording>(file, std::chrono::milliseconds(0));
                               }}),
    [](const auto& tested) { return tested.param.name; });

class ViewedRecordingTest : public testing::Test {
 protected:
  void write(std::size_t count) {
    rows = rows_of_movement(count);
    haptrace::write(file, rows);
  }
  TempFolder folder;
  std::string file = folder / "movement.h5";
  std::vector<Sample> rows;
};

TEST_F(ViewedRecordingTest, BeforeItIsBuiltBinsComeFromTheOverviewAndContainTheExactOnes) {
  write(300'000);
  ViewedRecording recording(file, std::chrono::milliseconds(0));
  const ViewChannels channels(kAllColumns);
  std::vector<Frame> answers;
  const ViewRequest all{
      .id = 6, .t0 = 0, .t1 = 1e6, .pixels = 50, .channels = {*channels.find("x"), *channels.find("force")}};
  const auto keep = [&](Frame frame) { answers.push_back(std::move(frame)); };
  recording.ask(all, keep);
  ASSERT_EQ(answers.size(), 1U) << "at once";
  EXPECT_NE(answers[0].flags & FrameFlags::kCoarse, 0);
  while (recording.work()) {
  }
  recording.ask(all, keep);
  ASSERT_EQ(answers.size(), 2U);
  EXPECT_EQ(answers[1].flags, 0);
  const test::DecodedBins coarse = test::decode_bins(message_of(answers[0])),
                          exact = test::decode_bins(message_of(answers[1]));
  ASSERT_EQ(coarse.width, exact.width);
  for (std::size_t i = 0; i < 2; ++i)
    for (std::size_t k = 0; k < exact.channels[i].min.size(); ++k) {
      if (std::isnan(exact.channels[i].min[k])) continue;
      EXPECT_LE(coarse.channels[i].min[k], exact.channels[i].min[k]);
      EXPECT_GE(coarse.channels[i].max[k], exact.channels[i].max[k]);
    }
  EXPECT_EQ(*std::max_element(exact.channels[1].max.begin(), exact.channels[1].max.end()), 8);
}

TEST_F(ViewedRecordingTest, AShortStretchIsBuiltBeforeALongOneAndThenItsNeighbours) {
  write(400'000);
  ViewedRecording recording(file, std::chrono::milliseconds(0));
  bool coarse = false;
  const auto note = [&](const Frame& frame) { coarse = (frame.flags & FrameFlags::kCoarse) != 0; };
  const ViewRequest near_end{.id = 1, .t0 = 300, .t1 = 320, .pixels = 50, .channels = {0}};
  const ViewRequest all{.id = 2, .t0 = 0, .t1 = 1e6, .pixels = 50, .channels = {0}};
  recording.ask(near_end, note);
  EXPECT_TRUE(coarse);
  recording.ask(all, note);
  int steps = 0;
  for (coarse = true; coarse && recording.work(); ++steps) recording.ask(near_end, note);
  EXPECT_LE(steps, 2) << "two blocks at most hold twenty seconds";
  while (recording.work()) ++steps;
  recording.ask(all, note);
  EXPECT_FALSE(coarse);
  EXPECT_GE(steps, 6) << "seven minutes are more than six blocks";
}

TEST_F(ViewedRecordingTest, TheMessagesDescribeTheFile) {
  write(20'000);
  ViewedRecording recording(file);
  const nlohmann::json message = recording.recording(3, "movement.h5");
  EXPECT_EQ(message["index"], 3);
  EXPECT_EQ(message["name"], "movement.h5");
  EXPECT_EQ(message["title"], "a title");
  EXPECT_EQ(message["verb"], "guide");
  EXPECT_EQ(message["mode"], "tunnel");
  EXPECT_EQ(message["input"], "mouse, depth from path");
  EXPECT_EQ(message["limits"]["max_deviation"], 0.1);
  EXPECT_FALSE(message["limits"].contains("max_speed"));
  EXPECT_EQ(message["columns"].size(), ViewChannels(kAllColumns).size());
  EXPECT_EQ(message["columns"][0], (nlohmann::json{{"name", "x"}, {"unit", "m"}}));
  EXPECT_NEAR(message["end"].get<double>(), 1e-9 * static_cast<double>(rows.back().time_ns), 1e-9);
  EXPECT_NEAR(message["bounds"]["max"][0].get<double>(), 0.05, 1e-3);

  const nlohmann::json events = recording.events();
  ASSERT_EQ(events["list"].size(), 2U);
  EXPECT_EQ(events["list"][0]["text"], "here");
  EXPECT_EQ(events["list"][0]["severity"], "");
  EXPECT_EQ(events["list"][1]["name"], "force_limit");
  EXPECT_EQ(events["list"][1]["severity"], "warning");

  while (!recording.scan_phases(std::chrono::milliseconds(0))) {
  }
  const nlohmann::json phases = recording.phases().all(true);
  EXPECT_EQ(phases["done"], true);
  ASSERT_EQ(phases["list"].size(), 2U);
  EXPECT_EQ(phases["list"][0][2], "approach");
  EXPECT_EQ(phases["list"][1][2], "run");
  EXPECT_NEAR(phases["list"][1][1].get<double>(), 1e-9 * static_cast<double>(rows.back().time_ns), 1e-9);
}

TEST_F(ViewedRecordingTest, ThePathIsThatOfTheFirstRunInTheOrderOfItsLength) {
  rows = rows_of_movement(20'000);
  std::reverse(rows.begin() + 5000, rows.end());  // the hand walks backwards
  for (std::size_t i = 0; i < rows.size(); ++i) rows[i].time_ns = static_cast<std::int64_t>(i) * 1'000'000;
  haptrace::write(file, rows);
  const ViewedRecording recording(file);
  const BinaryMessage path = message_of(recording.path());
  ASSERT_GT(path.rows, 100U);
  ASSERT_LE(path.rows, 4000U);
  EXPECT_FLOAT_EQ(path.plane(4)[0], 0.005F);
  const auto length = path.plane(5);
  EXPECT_TRUE(std::is_sorted(length.begin(), length.end()));
  EXPECT_LT(length.back(), 2) << "walked once, not there and back";
}

TEST_F(ViewedRecordingTest, AFileInATextFormatIsReadIntoMemory) {
  const std::string csv = folder.write("path.csv", "t,x,y,z\n0,0,0,0\n0.5,0.01,0,0\n1,0.02,0,0\n");
  ViewedRecording recording(csv);
  EXPECT_NEAR(recording.duration(), 1, 1e-9);
  std::optional<Frame> answer;
  recording.ask({.kind = ViewRequest::Kind::rows, .id = 1, .t0 = 0, .t1 = 2},
                [&](Frame frame) { answer = std::move(frame); });
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->rows, 3U);
  EXPECT_TRUE(recording.scan_phases(std::chrono::milliseconds(0)));
  EXPECT_EQ(recording.phases().size(), 1U);
  EXPECT_FALSE(recording.work());
}

TEST_F(ViewedRecordingTest, ARecordingWithoutRowsAnswersWithNothing) {
  haptrace::write(file, {});
  ViewedRecording recording(file);
  std::optional<Frame> answer;
  const auto take = [&](Frame frame) { answer = std::move(frame); };
  recording.ask({.id = 1, .t0 = 0, .t1 = 2, .pixels = 5, .channels = {0}}, take);
  EXPECT_LE(answer->rows, 1U);
  recording.ask({.kind = ViewRequest::Kind::rows, .id = 1, .t0 = 0, .t1 = 2}, take);
  EXPECT_EQ(answer->rows, 0U);
  EXPECT_EQ(recording.path().rows, 0U);
  EXPECT_FALSE(recording.work());
}

}  // namespace
}  // namespace haptrace
