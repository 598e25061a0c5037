#include "formats/path/path_source.h"

#include "formats/path/path_file.h"
#include "formats/path/path_thinning.h"
#include "report/recording_figure.h"
#include "tests/formats/support.h"

#include <algorithm>
#include <fmt/format.h>
#include <gmock/gmock.h>

namespace haptrace {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::Not;

/// Returns a session with long stretches of each phase, so that runs start and end within blocks of the overview and
/// cross their limits.
std::vector<Sample> session_of_runs(unsigned seed, std::size_t rows) {
  std::vector<Sample> session = random_session(seed, rows, {});
  std::mt19937 random(seed);
  std::uniform_int_distribution<std::size_t> length(1, rows / 6);
  std::uniform_int_distribution<int> phase(0, 3);
  for (std::size_t first = 0; first < rows;) {
    const std::size_t end = std::min(rows, first + length(random));
    const auto same = static_cast<Phase>(phase(random));
    for (; first < end; ++first) session[first].phase = same;
  }
  return session;
}

/// Returns a session without a run.
std::vector<Sample> free_session(unsigned seed, std::size_t rows) {
  std::vector<Sample> session = random_session(seed, rows, {});
  for (Sample& sample : session) sample.phase = Phase::idle;
  return session;
}

/// Returns the first row and the end of each run of a session, found row by row.
std::vector<std::pair<std::size_t, std::size_t>> runs_of(const std::vector<Sample>& session) {
  std::vector<std::pair<std::size_t, std::size_t>> runs;
  for (std::size_t i = 0; i < session.size(); ++i) {
    if (session[i].phase != Phase::run) continue;
    if (i == 0 || session[i - 1].phase != Phase::run) runs.emplace_back(i, i);
    runs.back().second = i + 1;
  }
  return runs;
}

void expect_rows(const Path& path, const std::vector<Sample>& session, std::size_t first, std::size_t end) {
  ASSERT_EQ(path.size(), end - first);
  for (std::size_t i = 0; i < path.size(); ++i) {
    ASSERT_EQ(path.position[i], session[first + i].position) << i;
    ASSERT_EQ(path.velocity[i], session[first + i].velocity) << i;
    ASSERT_EQ(path.time[i], 1e-9 * static_cast<double>(session[first + i].time_ns)) << i;
  }
}

/// Checks the laws of every source: its facts agree with its rows, its blocks cover all rows, and its pieces are equal
/// to its rows.
void expect_laws(const PathSource& source) {
  const PathFacts& facts = source.facts();
  const Path whole = source.read(0, facts.rows + 5);
  ASSERT_EQ(whole.size(), facts.rows);
  EXPECT_EQ(facts.begin, whole.time.front());
  EXPECT_EQ(facts.end, whole.time.back());
  EXPECT_EQ(facts.bounds.min, whole.bounds().min);
  EXPECT_EQ(facts.bounds.max, whole.bounds().max);
  EXPECT_EQ(facts.velocity, !whole.velocity.empty());
  EXPECT_EQ(facts.force, !whole.force.empty());
  double longest = 0;
  for (std::size_t i = 1; i < whole.size(); ++i) longest = std::max(longest, whole.time[i] - whole.time[i - 1]);
  EXPECT_NEAR(facts.longest_interval, longest, 1e-9);

  std::uint64_t row = 0;
  for (const PathBlock& block : source.blocks()) {
    ASSERT_EQ(block.first, row);
    ASSERT_GT(block.rows, 0U);
    row += block.rows;
    const Path piece = source.read(block.first, block.rows);
    EXPECT_EQ(block.bounds.min, piece.bounds().min);
    EXPECT_EQ(block.bounds.max, piece.bounds().max);
    EXPECT_LE(block.peak_speed, facts.peak_speed);
  }
  EXPECT_EQ(row, facts.rows);

  std::mt19937 random(1);
  std::uniform_int_distribution<std::uint64_t> any(0, facts.rows - 1);
  for (int i = 0; i < 30; ++i) {
    const std::uint64_t first = any(random), count = 1 + any(random) / 4;
    const Path piece = source.read(first, count);
    ASSERT_EQ(piece.size(), std::min(count, facts.rows - first));
    EXPECT_EQ(piece.time.front(), whole.time[first]);
    EXPECT_EQ(piece.position.back(), whole.position[first + piece.size() - 1]);
    EXPECT_EQ(source.row_at(whole.time[first]), first);
    EXPECT_EQ(source.row_at(whole.time[first] + 1e-6), first);
  }
  EXPECT_EQ(source.row_at(facts.begin - 1), 0U);
  EXPECT_EQ(source.row_at(facts.end + 1), facts.rows - 1);
}

TEST(PathSource, KeepsItsLawsInMemoryAndFromRecordingsWhateverIsChosen) {
  const TempFolder folder;
  for (const std::size_t rows : {1U, 2U, 300U, 8192U, 30'000U}) {
    const std::string file = folder / std::to_string(rows) + ".h5";
    write_recording(file, free_session(1, rows));
    for (const PathSelection& selection :
         {PathSelection{}, PathSelection{.from = 0.0}, PathSelection{.from = 1e-3 * double(rows / 3)},
          PathSelection{.to = 1e-3 * double(rows / 2)},
          PathSelection{.from = 1e-3 * double(rows / 3) + 1e-7, .to = 1e-3 * double(rows - 1) + 1}}) {
      if (selection.from > 1e-3 * double(rows - 1)) continue;
      SCOPED_TRACE(testing::Message() << rows << " rows from " << selection.from << " to " << selection.to);
      const auto recorded = source_of(RecordingReader(file), file, selection);
      expect_laws(*recorded);
      const auto memory = source_of(source_of(RecordingReader(file), file)->read(0, rows), selection);
      expect_laws(*memory);
      EXPECT_EQ(memory->facts().rows, recorded->facts().rows);
      EXPECT_EQ(memory->facts().begin, recorded->facts().begin);
    }
  }
}

TEST(PathSource, KeepsItsLawsWhenItIsThinnedAndKeepsEveryNthRowAndTheLast) {
  const TempFolder folder;
  for (const std::size_t rows : {1U, 2U, 10U, 8193U, 30'000U}) {
    const std::string file = folder / std::to_string(rows) + ".h5";
    write_recording(file, free_session(2, rows));
    const std::shared_ptr<const PathSource> whole = source_of(RecordingReader(file), file);
    const Path all = whole->read(0, rows);
    EXPECT_EQ(thinned(whole, 1), whole);
    for (const int every : {2, 3, 7, 10'000, 1'000'000}) {
      SCOPED_TRACE(testing::Message() << rows << " rows, every " << every);
      const auto thin = thinned(whole, every);
      expect_laws(*thin);
      const Path kept = thin->read(0, rows);
      for (std::size_t i = 0; i < kept.size(); ++i) {
        const std::size_t row = std::min(i * static_cast<std::size_t>(every), rows - 1);
        ASSERT_EQ(kept.time[i], all.time[row]) << i;
        ASSERT_EQ(kept.position[i], all.position[row]) << i;
        ASSERT_EQ(kept.velocity[i], all.velocity[row]) << i;
      }
      EXPECT_EQ(kept.size(), (rows - 1) / static_cast<std::size_t>(every) + 1 +
                                 ((rows - 1) % static_cast<std::size_t>(every) != 0 ? 1 : 0));
    }
    EXPECT_THROW((void)thinned(whole, 0), Error);
  }
}

TEST(PathSource, TakesTheSamplesOfTheRequestedRun) {
  const TempFolder folder;
  for (unsigned seed = 1; seed <= 12; ++seed) {
    const std::vector<Sample> session = session_of_runs(seed, 40'000);
    const std::string file = folder / std::to_string(seed) + ".h5";
    write_recording(file, session);
    const auto runs = runs_of(session);
    if (runs.empty()) {
      EXPECT_EQ(source_of(RecordingReader(file), file)->facts().rows, session.size());
      continue;
    }
    for (std::size_t k = 0; k < runs.size(); ++k) {
      const auto source = source_of(RecordingReader(file), file, {.repetition = static_cast<int>(k + 1)});
      expect_rows(source->read(0, session.size()), session, runs[k].first, runs[k].second);
      expect_laws(*source);
    }
    const auto last = source_of(RecordingReader(file), file);
    expect_rows(last->read(0, session.size()), session, runs.back().first, runs.back().second);
    if (runs.size() > 1) {
      EXPECT_THAT(last->facts().notes, Contains(HasSubstr("choose another with --repetition 1 to")));
    }
    for (const int wrong : {-1, 0, static_cast<int>(runs.size()) + 1})
      expect_error([&] { source_of(RecordingReader(file), file, {.repetition = wrong}); }, Error::Kind::input,
                   {fmt::format("there is no repetition {}; the recording has {}", wrong, runs.size())});
  }
}

TEST(PathSource, PrefersARepetitionThatWasNotCutShort) {
  const TempFolder folder;
  std::vector<Sample> session = random_session(3, 3600, {});
  for (std::size_t i = 0; i < session.size(); ++i) session[i].phase = i % 1200 < 1000 ? Phase::run : Phase::hold;
  const auto recorded = [&](const char* name, const std::vector<std::size_t>& cut, EventCode code) {
    const std::string file = folder / name;
    RecordingWriter writer(file, {}, {}, {});
    writer.append(session);
    for (const std::size_t run : cut)
      writer.append(StoredEvent{.time = 1e-9 * static_cast<double>(session[1200 * run + 1000].time_ns),
                                .code = static_cast<std::int32_t>(code)});
    writer.append(StoredEvent{.time = 1e-9 * static_cast<double>(session[1500].time_ns),
                              .code = static_cast<std::int32_t>(EventCode::mark)});
    writer.finish();
    return file;
  };
  const std::string third = recorded("third.h5", {2}, EventCode::time_over),
                    all = recorded("all.h5", {0, 1, 2}, EventCode::interrupted);
  const auto chosen = source_of(RecordingReader(third), third);
  expect_rows(chosen->read(0, 3600), session, 1200, 2200);
  EXPECT_FALSE(chosen->facts().cut_short);
  EXPECT_THAT(chosen->facts().notes, Contains(HasSubstr("last of 3 repetitions that was not cut short, number 2")));
  const auto asked = source_of(RecordingReader(third), third, {.repetition = 3});
  EXPECT_TRUE(asked->facts().cut_short);
  EXPECT_THAT(asked->facts().notes, Contains(HasSubstr("was cut short by a time limit, a stop or a fault")));
  const auto last = source_of(RecordingReader(all), all);
  expect_rows(last->read(0, 3600), session, 2400, 3400);
  EXPECT_TRUE(last->facts().cut_short);
}

TEST(PathSource, LeavesTheSupportOfTheArmOutOfTheForcesOfARecording) {
  const Vec3 task(0.4, 0, -0.3);
  std::vector<Sample> session = session_of_runs(2, 6000);
  for (std::size_t i = 0; i < session.size(); ++i) {
    Sample& sample = session[i];
    sample.support = Vec3(0, 0, 1.5 + std::sin(1e-3 * static_cast<double>(i)));  // as a therapist changes it
    sample.force = task + sample.support;
    sample.force_measured = -sample.force;
  }
  const TempFolder folder;
  const std::string file = folder / "supported.h5";
  write_recording(file, session, {.force_measured = true, .support = true});
  const auto sent = open_path(file);
  EXPECT_TRUE(sent->facts().supported);
  EXPECT_THAT(sent->facts().notes, Not(Contains(HasSubstr("stuck"))));
  for (const Vec3& force : sent->read(0, sent->facts().rows).force) EXPECT_LT((force - task).norm(), 1e-6);
  const auto measured = open_path(file, {.measured = true, .negated = true});
  for (const Vec3& force : measured->read(0, measured->facts().rows).force) EXPECT_LT((force + task).norm(), 1e-6);
}

TEST(PathSource, SaysWhyNothingCanBeChosen) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  write_recording(file, free_session(1, 1000));
  expect_error([&] { open_path(file, {.from = 2}); }, Error::Kind::input, {"no sample from 2 s", "0.999 s"});
  expect_error([&] { open_path(file, {.from = 0.5, .to = 0.4}); }, Error::Kind::input, {"is not a valid time range"});
  expect_error([&] { open_path(file, {.from = 0.1001, .to = 0.1002}); }, Error::Kind::input, {"no sample from"});
  const std::string csv = folder.write("a.csv", "t,x,y,z\n0,0,0,0\n1,0,0,0\n");
  expect_error([&] { open_path(csv, {.from = 2}); }, Error::Kind::input, {"no sample from 2 s", "1.000 s"});
  expect_error([&] { open_path(csv, {.repetition = 1}); }, Error::Kind::input, {"only be chosen from a recording"});
  EXPECT_EQ(open_path(csv, {.from = 0.5})->facts().rows, 1U);
}

TEST(PathSource, NamesTheSampleOfAPositionThatIsNotFinite) {
  const TempFolder folder;
  std::vector<Sample> session = free_session(1, 20'000);
  session[12'344].position.y() = kNaN;
  write_recording(folder / "a.h5", session);
  expect_error([&] { open_path(folder / "a.h5"); }, Error::Kind::input,
               {"sample 12345: position is not a finite number"});
  EXPECT_EQ(open_path(folder / "a.h5", {.to = 12.343})->facts().rows, 12'344U);
}

/// Returns true if a line contains a value.
bool shows(const std::vector<double>& line, double value) {
  return std::any_of(line.begin(), line.end(), [&](double v) { return std::abs(v - value) < 1e-9; });
}

TEST(FigureOfARecording, KeepsASpikeOfOneRowAmongMillionsOverTimeAndInSpace) {
  const TempFolder folder;
  constexpr std::size_t kRows = 2'000'000, kSpike = 1'234'567, kOther = 654'321;
  {
    RecordingWriter writer(folder / "a.h5", {}, {}, {});
    std::vector<Sample> block;
    for (std::size_t i = 0; i < kRows; ++i) {
      Sample& sample = block.emplace_back();
      sample.tick = i;
      sample.time_ns = static_cast<std::int64_t>(i) * 1'000'000;
      const double t = 1e-3 * static_cast<double>(i);
      sample.position = Vec3(0.05 * std::cos(t), 0.04 * std::sin(t),
                             i == kSpike   ? -0.03
                             : i == kOther ? 0.02
                                           : 0.001 * std::sin(7 * t));
      if (i == kSpike) sample.force = Vec3(0, 9, 0);
      if (block.size() == 8192 || i + 1 == kRows) {
        writer.append(block);
        block.clear();
      }
    }
    writer.finish();
  }
  std::uint64_t told = 0;
  const Figure figure = figure_of(RecordingReader(folder / "a.h5"), "title", [&](std::uint64_t rows) { told = rows; });
  EXPECT_EQ(told, kRows);
  ASSERT_EQ(figure.rows.size(), 3U);
  ASSERT_EQ(figure.rows[0].size(), 2U);
  for (const double spike : {-30, 20}) {
    EXPECT_TRUE(shows(figure.rows[0][1].series[0].y, spike)) << "in space";
    EXPECT_TRUE(shows(figure.rows[1][0].series[2].y, spike)) << "position over time";
  }
  EXPECT_TRUE(shows(figure.rows[2][0].series[1].y, 9)) << "force over time";
  for (const auto& row : figure.rows)
    for (const Panel& panel : row)
      for (const Series& series : panel.series) EXPECT_LE(series.x.size(), 8000U);
}

}  // namespace
}  // namespace haptrace
