#include "formats/convert/resample.h"

#include "tests/formats/support.h"

#include <cmath>
#include <gmock/gmock.h>
#include <numbers>

namespace haptrace {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;

/// A source of samples in memory, in blocks of an unusual size.
class Given final : public RecordingSource {
 public:
  explicit Given(std::vector<Sample> samples, std::size_t block = 777) : samples_(std::move(samples)), block_(block) {
    header_.uuid = "original";
  }
  [[nodiscard]] const RecordingHeader& header() const override { return header_; }
  [[nodiscard]] const RecordingColumns& columns() const override { return columns_; }
  [[nodiscard]] std::vector<StoredEvent> events() const override { return {{1.5, 50, "here"}}; }
  std::span<const Sample> next() override {
    const std::size_t count = std::min(block_, samples_.size() - at_);
    at_ += count;
    return std::span(samples_).subspan(at_ - count, count);
  }
  [[nodiscard]] double fraction() const override { return 0; }
  [[nodiscard]] std::vector<std::string> notes() const override { return {}; }

 private:
  RecordingHeader header_;
  RecordingColumns columns_;
  std::vector<Sample> samples_;
  std::size_t block_, at_ = 0;
};

struct Result {
  std::vector<Sample> samples;
  ResampleReport report;
  std::vector<std::string> notes;
};

Result run(const std::vector<Sample>& samples, const ResampleOptions& options, std::size_t block = 777) {
  const auto source = resample(std::make_unique<Given>(samples, block), options);
  Result result;
  for (auto rows = source->next(); !rows.empty(); rows = source->next())
    result.samples.insert(result.samples.end(), rows.begin(), rows.end());
  EXPECT_TRUE(source->next().empty());
  EXPECT_NE(source->header().uuid, "original");
  EXPECT_EQ(source->header().rate_hz, options.rate_hz);
  EXPECT_EQ(source->events().at(0).text, "here");
  result.report = source->report();
  result.notes = source->notes();
  EXPECT_EQ(result.report.rows_out, result.samples.size());
  return result;
}

Vec3 smooth(double t) {
  return 0.1 * Vec3(std::sin(9 * t), std::cos(7 * t), std::sin(5 * t + 1));
}

/// Returns a movement at 1 kHz with randomly dropped samples, like a real log.
std::vector<Sample> movement(std::size_t rows, unsigned seed = 1, bool velocity = false) {
  std::mt19937_64 random(seed);
  std::vector<Sample> samples(rows);
  std::int64_t ms = 0;
  for (std::size_t i = 0; i < rows; ++i, ms += random() % 4 == 0 ? 2 : 1) {
    const double t = 1e-3 * static_cast<double>(ms);
    samples[i].time_ns = ms * 1'000'000;
    samples[i].tick = i;
    samples[i].position = smooth(t);
    if (velocity) samples[i].velocity = Vec3(t, 2 * t, 3);
    samples[i].force = Vec3(t, -t, 1);
    samples[i].phase = Phase::run;
    samples[i].buttons = static_cast<std::uint32_t>(i);
  }
  return samples;
}

Path path_of(const std::vector<Sample>& samples) {
  Path path;
  path.name = "test";
  for (const Sample& sample : samples) {
    path.time.push_back(1e-9 * static_cast<double>(sample.time_ns));
    path.position.push_back(sample.position);
  }
  return path;
}

TEST(Resample, PutsEveryRowOnTheGridWithTicksInOrder) {
  for (const double hz : {100.0, 333.0, 1000.0, 4999.5}) {
    const std::vector<Sample> in = movement(9000);
    const Result out = run(in, {.rate_hz = hz});
    ASSERT_FALSE(out.samples.empty());
    for (std::size_t i = 0; i < out.samples.size(); ++i) {
      EXPECT_EQ(out.samples[i].tick, i);
      EXPECT_EQ(out.samples[i].time_ns, std::llround(static_cast<double>(i) * 1e9 / hz));
    }
    EXPECT_LE(out.samples.back().time_ns, in.back().time_ns);
    EXPECT_GT(static_cast<double>(out.samples.back().time_ns), static_cast<double>(in.back().time_ns) - 1e9 / hz);
  }
}

TEST(Resample, InPiecesIsTheCurveOfTheWholeToTheLastDigits) {
  const std::vector<Sample> in = movement(20'000);
  for (const Interpolation method :
       {Interpolation::hold, Interpolation::linear, Interpolation::cubic, Interpolation::quintic}) {
    const Trajectory whole(path_of(in), method);
    const Result out = run(in, {.rate_hz = 1234.5, .method = method});
    double worst = 0, worst_velocity = 0;
    for (const Sample& sample : out.samples) {
      const double t = 1e-9 * static_cast<double>(sample.time_ns);
      // The whole curve starts and ends at rest, the resampled one does not. Their difference decays within 0.1 s.
      if (t < 0.1 || t > whole.duration() - 0.1) continue;
      const Reference reference = whole.sample(t);
      worst = std::max(worst, (sample.position - reference.position).norm());
      if (method != Interpolation::hold)
        worst_velocity = std::max(worst_velocity, (sample.velocity - reference.velocity).norm());
    }
    EXPECT_LT(worst, 1e-14) << to_string(method);
    EXPECT_LT(worst_velocity, 1e-9) << to_string(method);
  }
}

/// Returns the amplitude [m] of a sine of `hz` along x in the positions, without the first and last `edge` seconds.
double amplitude(const std::vector<Sample>& samples, double hz, double edge) {
  double sine = 0, cosine = 0, count = 0;
  const double end = 1e-9 * static_cast<double>(samples.back().time_ns);
  for (const Sample& sample : samples) {
    const double t = 1e-9 * static_cast<double>(sample.time_ns);
    if (t < edge || t > end - edge) continue;
    sine += sample.position.x() * std::sin(2 * std::numbers::pi * hz * t);
    cosine += sample.position.x() * std::cos(2 * std::numbers::pi * hz * t);
    count += 1;
  }
  return 2 * std::hypot(sine, cosine) / count;
}

std::vector<Sample> sine(double hz, std::size_t rows, double rate = 1000) {
  std::vector<Sample> samples(rows);
  for (std::size_t i = 0; i < rows; ++i) {
    const double t = static_cast<double>(i) / rate;
    samples[i].time_ns = std::llround(1e9 * t);
    samples[i].tick = i;
    samples[i].position = samples[i].force = Vec3(std::sin(2 * std::numbers::pi * hz * t), 0, 0);
    samples[i].phase = Phase::run;
  }
  return samples;
}

TEST(Resample, ToALowerRateRemovesAliases) {
  // Sampled at 100 Hz, 98 Hz looks like 2 Hz.
  const Result aliased = run(sine(98, 12'000), {.rate_hz = 100, .low_pass_hz = 0.0});
  EXPECT_NEAR(amplitude(aliased.samples, 2, 1), 1, 0.02);
  EXPECT_EQ(aliased.report.low_pass_hz, 0);
  EXPECT_THAT(aliased.notes, IsEmpty());

  for (const double hz : {51.0, 60.0, 98.0, 290.0}) {
    const Result out = run(sine(hz, 12'000), {.rate_hz = 100});
    EXPECT_LT(amplitude(out.samples, std::abs(hz - 100 * std::round(hz / 100)), 1), 0.002) << hz;
    EXPECT_NEAR(out.report.low_pass_hz, 100 / 2.4, 1e-9);
    EXPECT_NEAR(out.report.rms_difference, std::sqrt(0.5), 0.1) << hz;
    EXPECT_THAT(out.notes, Contains(HasSubstr("low-pass filter at 41.67 Hz")));
  }
}

TEST(Resample, ToALowerRateDoesNotChangeSlowMovements) {
  for (const double hz : {0.5, 2.0, 10.0, 30.0}) {
    const Result out = run(sine(hz, 12'000), {.rate_hz = 100});
    double worst = 0, worst_force = 0;
    for (const Sample& sample : out.samples) {
      const double t = 1e-9 * static_cast<double>(sample.time_ns);
      if (t < 0.5 || t > 11.5) continue;
      const double truth = std::sin(2 * std::numbers::pi * hz * t);
      worst = std::max(worst, std::abs(sample.position.x() - truth));
      worst_force = std::max(worst_force, std::abs(sample.force.x() - truth));
    }
    EXPECT_LT(worst, 0.002) << hz;
    EXPECT_LT(worst_force, 0.01) << hz;  // linear interpolation between samples of 1 kHz
  }
}

TEST(Resample, FiltersNoFartherThanValuesAreKnownAndLeavesStraightLinesStraight) {
  std::vector<Sample> in = sine(0, 9000);
  for (std::size_t i = 0; i < in.size(); ++i) {
    in[i].time_ns += i >= 5000 ? 2'000'000'000 : 0;  // a gap, after which the hand is elsewhere
    const double t = 1e-9 * static_cast<double>(in[i].time_ns);
    in[i].position = Vec3(t, i >= 5000 ? 7 : -7, 1);
    in[i].force = i >= 2000 && i < 2100 ? nan3() : Vec3(1, t, 0);
    in[i].orientation = Quat(i % 2 == 0 ? 1 : -1, 0, 0, 0);  // q and -q are the same orientation
  }
  const Result out = run(in, {.rate_hz = 50});
  std::size_t unknown = 0;
  for (const Sample& sample : out.samples) {
    const double t = 1e-9 * static_cast<double>(sample.time_ns);
    EXPECT_NEAR((sample.position - Vec3(t, t > 6 ? 7 : -7, 1)).norm(), 0, 1e-12) << t;
    EXPECT_NEAR(std::abs(sample.orientation.w()), 1, 1e-12);
    unknown += is_finite(sample.force) ? 0 : 1;
    if (is_finite(sample.force)) {
      EXPECT_NEAR((sample.force - Vec3(1, t, 0)).norm(), 0, 1e-9) << t;
    }
  }
  EXPECT_GE(unknown, 4U);
  EXPECT_LE(unknown, 6U);
}

TEST(Resample, WithAnExplicitCutOffFiltersAtAnyRate) {
  const Result out = run(sine(100, 6000), {.rate_hz = 2000, .low_pass_hz = 20.0});
  EXPECT_LT(amplitude(out.samples, 100, 1), 0.002);
  for (const double hz : {-1.0, 500.0, kNaN}) EXPECT_THROW(run(sine(1, 100), {.low_pass_hz = hz}), Error) << hz;
  EXPECT_THROW(run(sine(1, 100), {.rate_hz = 100, .low_pass_hz = 50.0}), Error) << "a new rate needs its own half";
}

TEST(Resample, IsAsGoodAtTheEndsAsInTheMiddle) {
  const std::vector<Sample> in = movement(5000);
  const Result out = run(in, {.rate_hz = 2000});
  double middle = 0, ends = 0;
  for (const Sample& sample : out.samples) {
    const double t = 1e-9 * static_cast<double>(sample.time_ns);
    double& worst = t > 1 && t < 5 ? middle : ends;
    worst = std::max(worst, (sample.position - smooth(t)).norm());
  }
  EXPECT_LT(middle, 1e-9);
  EXPECT_LT(ends, 2e-6);  // the curve has no acceleration at its ends: an error of a h^2 / 16 for a true acceleration a
}

TEST(Resample, ChangesNothingOnAnExistingGrid) {
  std::vector<Sample> in = movement(3000, 1, true);
  for (std::size_t i = 0; i < in.size(); ++i) in[i].time_ns = static_cast<std::int64_t>(i) * 1'000'000;
  for (const Interpolation method : {Interpolation::hold, Interpolation::linear, Interpolation::cubic}) {
    const Result out = run(in, {.rate_hz = 1000, .method = method});
    expect_same(out.samples, in);
    EXPECT_LT(out.report.max_difference, 1e-18);
    EXPECT_EQ(out.report.compared, 2999U);
  }
}

TEST(Resample, DoesNotDependOnHowTheSourceIsCutIntoBlocks) {
  const std::vector<Sample> in = movement(5000);
  const std::vector<Sample> first = run(in, {.rate_hz = 800, .max_gap = 0.02}, 5000).samples;
  for (const std::size_t block : {100U, 2049U, 4096U})
    expect_same(run(in, {.rate_hz = 800, .max_gap = 0.02}, block).samples, first);
}

TEST(Resample, LeavesGapsAndNamesThem) {
  std::vector<Sample> in = movement(6000);
  for (std::size_t i = 2000; i < in.size(); ++i) in[i].time_ns += 500'000'000;
  for (std::size_t i = 4000; i < in.size(); ++i) in[i].time_ns += 2'000'000'000;
  const Result out = run(in, {.rate_hz = 1000});
  EXPECT_EQ(out.report.gaps, 2U);
  EXPECT_NEAR(out.report.longest_gap, 2.001, 0.0011);
  EXPECT_NEAR(out.report.max_gap, 0.02, 1e-9);
  std::size_t jumps = 0;
  for (std::size_t i = 1; i < out.samples.size(); ++i) {
    const std::int64_t step = out.samples[i].time_ns - out.samples[i - 1].time_ns;
    EXPECT_EQ(step, static_cast<std::int64_t>(out.samples[i].tick - out.samples[i - 1].tick) * 1'000'000);
    if (step == 1'000'000) continue;
    ++jumps;
    EXPECT_EQ(out.samples[i - 1].time_ns, in[jumps == 1 ? 1999 : 3999].time_ns);
    EXPECT_EQ(out.samples[i].time_ns, in[jumps == 1 ? 2000 : 4000].time_ns);
  }
  EXPECT_EQ(jumps, 2U);
  ASSERT_EQ(out.notes.size(), 1U);
  EXPECT_NE(out.notes[0].find("2 gaps longer than 0.02 s were not filled"), std::string::npos) << out.notes[0];
  const Result bridged = run(in, {.rate_hz = 1000, .max_gap = 10});
  EXPECT_EQ(bridged.report.gaps, 0U);
  EXPECT_EQ(bridged.samples.back().tick + 1, bridged.samples.size());
}

TEST(Resample, DropsDuplicatesStampsThatGoBackAndRowsWithoutAPositionAndCountsThem) {
  const std::vector<Sample> clean = movement(3000);
  std::vector<Sample> spoilt = clean;
  Sample duplicate = clean[1000], backward = clean[500], nowhere = clean[2000];
  duplicate.position = Vec3(9, 9, 9);
  backward.position = Vec3(8, 8, 8);
  nowhere.time_ns += 100;
  nowhere.position = nan3();
  spoilt.insert(spoilt.begin() + 2001, nowhere);
  spoilt.insert(spoilt.begin() + 1001, {duplicate, duplicate, backward});
  const Result out = run(spoilt, {.rate_hz = 1000});
  expect_same(out.samples, run(clean, {.rate_hz = 1000}).samples);
  EXPECT_EQ(out.report.duplicates, 2U);
  EXPECT_EQ(out.report.backward, 1U);
  EXPECT_EQ(out.report.without_position, 1U);
  EXPECT_EQ(out.report.rows_in, spoilt.size());
  EXPECT_EQ(out.notes.size(), 3U);
}

TEST(Resample, InterpolatesForcesHoldsDiscreteValuesAndTurnsOrientations) {
  std::vector<Sample> in(2);
  in[1].time_ns = 10'000'000;
  for (Sample& sample : in) sample.position = Vec3::Zero();
  in[0].force = Vec3(0, 1, 2);
  in[1].force = Vec3(10, 1, kNaN);
  in[0].phase = Phase::approach;
  in[1].phase = Phase::run;
  in[0].buttons = 1;
  in[0].latency = 5e-6F;
  in[0].orientation = Quat(1, 0, 0, 0);
  in[1].orientation = Quat(0, 0, 0, 1);
  in[0].reference_position = Vec3(1, 1, 1);
  const Result out = run(in, {.rate_hz = 200, .method = Interpolation::linear, .low_pass_hz = 0.0});
  ASSERT_EQ(out.samples.size(), 3U);
  const Sample& middle = out.samples[1];
  EXPECT_EQ(middle.force.x(), 5);
  EXPECT_EQ(middle.force.y(), 1);
  EXPECT_TRUE(std::isnan(middle.force.z()));
  EXPECT_EQ(middle.phase, Phase::approach);
  EXPECT_EQ(middle.buttons, 1U);
  EXPECT_EQ(middle.latency, 5e-6F);
  EXPECT_NEAR(middle.orientation.w(), std::sqrt(0.5), 1e-12);
  EXPECT_NEAR(middle.orientation.z(), std::sqrt(0.5), 1e-12);
  EXPECT_FALSE(is_finite(middle.reference_position));
  EXPECT_EQ(out.samples[0].reference_position, Vec3(1, 1, 1));
  EXPECT_EQ(out.samples[2].phase, Phase::run);
  EXPECT_EQ(run(in, {.rate_hz = 200, .method = Interpolation::hold, .low_pass_hz = 0.0}).samples[1].force.x(), 0);
}

TEST(Resample, KeepsARecordedVelocityAndEstimatesAMissingOne) {
  for (const Sample& sample : run(movement(2000, 1, true), {.rate_hz = 700, .low_pass_hz = 0.0}).samples)
    EXPECT_NEAR(sample.velocity.y(), 2e-9 * static_cast<double>(sample.time_ns), 1e-12);
  const std::vector<Sample> made = run(movement(2000), {.rate_hz = 700}).samples;
  for (std::size_t i = 100; i < 1000; ++i)
    EXPECT_NEAR(made[i].velocity.x(), 0.9 * std::cos(9e-9 * static_cast<double>(made[i].time_ns)), 1e-5);
}

TEST(Resample, SaysHowFarTheNewRowsAreFromTheOld) {
  const std::vector<Sample> in = movement(8000);
  const double fine = run(in, {.rate_hz = 1000}).report.rms_difference;
  const double coarse = run(in, {.rate_hz = 10, .low_pass_hz = 0.0}).report.rms_difference;
  EXPECT_LT(fine, 1e-8);
  EXPECT_GT(coarse, 1e-5);
  EXPECT_LT(coarse, 1e-2);
  EXPECT_GE(run(in, {.rate_hz = 10, .low_pass_hz = 0.0}).report.max_difference, coarse);
}

TEST(Resample, AcceptsFewSamplesAndNone) {
  EXPECT_TRUE(run({}, {.rate_hz = 100}).samples.empty());
  EXPECT_EQ(run(movement(1), {.rate_hz = 100}).samples.size(), 1U);
  EXPECT_EQ(run(movement(2), {.rate_hz = 1000}).samples.back().time_ns, movement(2).back().time_ns);
  expect_error([&] { (void)run({}, {.rate_hz = 0}); }, Error::Kind::input, {"--resample: 0 is not a rate"});
  expect_error([&] { (void)run({}, {.rate_hz = kNaN}); }, Error::Kind::input, {"is not a rate"});
  expect_error([&] { (void)run({}, {.max_gap = -1}); }, Error::Kind::input, {"--max-gap: -1 is not a duration"});
}

}  // namespace
}  // namespace haptrace
