#include "formats/recording/recording_summary.h"

#include "formats/recording/recording_layout.h"
#include "tests/formats/support.h"

namespace haptrace {
namespace {

RecordingSummary summary_of(std::span<const Sample> samples) {
  Summariser summariser;
  summariser.add(samples);
  return summariser.take();
}

/// Returns a session with the irregularities of real ones: gaps, runs, unknown columns and lost positions.
std::vector<Sample> eventful_session(unsigned seed, std::size_t rows) {
  std::mt19937 random(seed);
  std::vector<Sample> session = random_session(seed, rows, {.reference = true});
  std::uint64_t skipped = 0;
  Phase phase = Phase::approach;
  for (std::size_t i = 0; i < rows; ++i) {
    if (random() % 20 == 0) skipped += random() % 30;
    if (random() % 25 == 0) phase = phase == Phase::run ? Phase::hold : Phase::run;
    session[i].tick += skipped;
    session[i].time_ns += static_cast<std::int64_t>(skipped) * 1'000'000;
    session[i].phase = phase;
    if (random() % 40 == 0) session[i].velocity = nan3();
    if (random() % 40 == 0) session[i].force = nan3();
    if (random() % 40 == 0) session[i].position = nan3();
    if (random() % 3 == 0) session[i].reference_position = nan3();
  }
  return session;
}

void expect_same_figures(const RecordingSummary& a, const RecordingSummary& b) {
  for (const layout::OverviewField& field : layout::overview_fields()) {
    std::array<std::byte, 24> left{}, right{};
    field.pack(a, left.data());
    field.pack(b, right.data());
    for (std::size_t i = 0; i < field.width; ++i) {
      if (field.floating) {
        double x = 0, y = 0;
        std::memcpy(&x, left.data() + 8 * i, 8);
        std::memcpy(&y, right.data() + 8 * i, 8);
        const bool same = x == y || (std::isnan(x) && std::isnan(y)) || std::abs(x - y) <= 1e-12 * (1 + std::abs(y));
        EXPECT_TRUE(same) << field.name << ": " << x << ", " << y;
      } else {
        EXPECT_EQ(std::memcmp(left.data(), right.data(), 8), 0) << field.name;
      }
    }
  }
}

TEST(RecordingSummary, OfJoinedBlocksEqualsThatOfTheWholeHoweverItIsCut) {
  std::mt19937 random(1);
  for (unsigned seed = 0; seed < 50; ++seed) {
    const std::vector<Sample> session = eventful_session(seed, 400);
    Summariser summariser;
    RecordingSummary joined;
    for (std::span<const Sample> rest = session; !rest.empty();) {
      const std::size_t count = std::min<std::size_t>(rest.size(), random() % 90);
      summariser.add(rest.first(count));
      joined.join(summariser.take());
      rest = rest.subspan(count);
    }
    expect_same_figures(joined, summary_of(session));
  }
}

TEST(RecordingSummary, IsJoinedInAnyGrouping) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    const std::vector<Sample> session = eventful_session(seed, 300);
    const std::span<const Sample> all(session);
    const RecordingSummary a = summary_of(all.first(100)), b = summary_of(all.subspan(100, 100)),
                           c = summary_of(all.subspan(200));
    RecordingSummary left = a, right_tail = b, right = a;
    left.join(b);
    left.join(c);
    right_tail.join(c);
    right.join(right_tail);
    expect_same_figures(left, right);

    RecordingSummary with_nothing = a;
    with_nothing.join({});
    expect_same_figures(with_nothing, a);
    RecordingSummary nothing;
    nothing.join(a);
    expect_same_figures(nothing, a);
  }
}

TEST(RecordingSummary, ReportsGapsRunsAndExtremesOfAKnownSession) {
  std::vector<Sample> session(100);
  for (std::size_t i = 0; i < session.size(); ++i) {
    Sample& s = session[i];
    s.tick = i < 60 ? i : i + 5;
    s.time_ns = static_cast<std::int64_t>(s.tick) * 1'000'000;
    s.position = Vec3(1e-4 * static_cast<double>(s.tick), 0, 0);  // 0.1 m/s
    s.velocity = Vec3(0.1, 0, 0);
    s.force = Vec3(0, i == 30 ? -4.0 : 1.0, 0);
    s.phase = (i >= 10 && i < 40) || i >= 70 ? Phase::run : Phase::hold;
    s.reference_position = s.position + Vec3(0, 0, i == 80 ? 3e-3 : 1e-3);
  }
  const RecordingSummary summary = summary_of(session);
  EXPECT_EQ(summary.rows, 100U);
  EXPECT_EQ(summary.gaps, 1U);
  EXPECT_EQ(summary.missed, 5U);
  EXPECT_NEAR(summary.longest_interval, 6e-3, 1e-12);
  EXPECT_NEAR(summary.duration(), 0.104, 1e-12);
  EXPECT_NEAR(summary.mean_rate(), 99 / 0.104, 1e-9);
  EXPECT_EQ(summary.runs, 2U);
  EXPECT_EQ(summary.run_rows, 60U);
  EXPECT_TRUE(summary.ends_in_run);
  EXPECT_FALSE(summary.begins_in_run);
  EXPECT_NEAR(summary.run_bounds.min.x(), 1e-3, 1e-12);
  EXPECT_NEAR(summary.path_length, 0.0104, 1e-12);
  EXPECT_NEAR(summary.peak_speed, 0.1, 1e-9);
  EXPECT_NEAR(summary.run_peak_speed, 0.1, 1e-9);
  EXPECT_EQ(summary.max_force, 4);
  EXPECT_EQ(summary.tracked, 60U);
  EXPECT_NEAR(summary.peak_error(), 3e-3, 1e-12);
  EXPECT_NEAR(summary.rms_error(), std::sqrt((59 * 1e-6 + 9e-6) / 60), 1e-12);
}

TEST(RecordingSummary, CountsTheSpeedOfRunsByThemselves) {
  std::vector<Sample> session(200);
  double x = 0;
  for (std::size_t i = 0; i < session.size(); ++i) {
    const bool run = (i >= 50 && i < 100) || i >= 150;
    x += run ? 1e-4 : 1e-3;  // 0.1 and 1 m/s
    session[i].tick = i;
    session[i].time_ns = static_cast<std::int64_t>(i) * 1'000'000;
    session[i].position = Vec3(x, 0, 0);
    session[i].phase = run ? Phase::run : Phase::approach;
  }
  for (const std::size_t block : {200U, 7U, 1U}) {
    Summariser summariser;
    RecordingSummary joined;
    for (std::size_t first = 0; first < session.size(); first += block) {
      summariser.add(std::span(session).subspan(first, std::min<std::size_t>(block, session.size() - first)));
      joined.join(summariser.take());
    }
    EXPECT_NEAR(joined.peak_speed, 1, 1e-9);
    EXPECT_NEAR(joined.run_peak_speed, 0.1, 1e-9) << "in blocks of " << block;
  }
}

TEST(RecordingSummary, OfNoSamplesHasNoMisleadingValues) {
  const RecordingSummary nothing;
  EXPECT_EQ(nothing.mean_rate(), 0);
  EXPECT_EQ(nothing.duration(), 0);
  EXPECT_TRUE(std::isnan(nothing.rms_error()));
  EXPECT_TRUE(std::isnan(nothing.peak_error()));
}

TEST(Overview, CoversAllRowsOfItsFile) {
  const TempFolder folder;
  const std::vector<Sample> session = eventful_session(5, 3 * 8192 + 100);
  write_recording(folder / "a.h5", session, {.reference = true});
  const RecordingReader reader(folder / "a.h5");
  bool read_rows = false;
  const auto blocks = reader.overview([&](std::uint64_t) { read_rows = true; });
  EXPECT_EQ(blocks.size(), 4U);
  EXPECT_FALSE(read_rows) << "the file keeps all of it";
  expect_same_figures(summarise(reader), summary_of(session));
}

TEST(Overview, IsCompletedFromTheRowsOfAnUnfinishedRecording) {
  const TempFolder folder;
  const std::vector<Sample> session = eventful_session(6, 2 * 8192 + 777);
  RecordingWriter writer(folder / "a.h5", {}, {.reference = true}, {});
  writer.append(session);
  writer.flush();
  const RecordingReader reader(folder / "a.h5");
  std::uint64_t told = 0;
  const auto blocks = reader.overview([&](std::uint64_t rows) { told = rows; });
  EXPECT_EQ(blocks.size(), 3U);
  EXPECT_EQ(told, session.size());
  RecordingSummary whole;
  for (const RecordingSummary& block : blocks) whole.join(block);
  EXPECT_EQ(whole.rows, session.size());
  EXPECT_EQ(whole.gaps, summary_of(session).gaps);
  EXPECT_EQ(whole.runs, summary_of(session).runs);
}

TEST(Overview, FindsTheRowOfAnyInstant) {
  const TempFolder folder;
  const std::vector<Sample> session = eventful_session(7, 3000);
  write_recording(folder / "a.h5", session, {.reference = true});
  const RecordingReader reader(folder / "a.h5");
  EXPECT_EQ(reader.row_at(-5), 0U);
  EXPECT_EQ(reader.row_at(session.back().time_ns + 5'000'000'000), session.size() - 1);
  for (std::size_t row = 0; row < session.size(); row += 37) {
    EXPECT_EQ(reader.row_at(session[row].time_ns), row);
    if (row > 0) {
      EXPECT_EQ(reader.row_at(session[row].time_ns - 1), row - 1);
    }
  }
}

}  // namespace
}  // namespace haptrace
