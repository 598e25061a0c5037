// Damage to recordings: killed processes, full and failing disks, truncated files and flipped bytes.
#include "formats/recording/recording.h"
#include "tests/formats/support.h"

#include <csignal>
#include <fcntl.h>
#include <fmt/format.h>
#include <hdf5.h>
#include <iostream>
#include <optional>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

namespace haptrace {
namespace {

constexpr std::size_t kBatch = 50;  // rows between two flushes

/// A process that appends the session in batches of kBatch rows, flushes each and reports the number of safe rows.
class WriterProcess {
 public:
  WriterProcess(const std::string& file, std::span<const Sample> session, std::size_t rows_per_chunk) {
    int ends[2];
    if (pipe(ends) != 0) throw std::runtime_error("no pipe");
    process_ = fork();
    if (process_ == 0) {
      RecordingWriter writer(file, {}, {}, {.storage = {.rows_per_chunk = rows_per_chunk}});
      for (std::size_t first = 0; first + kBatch <= session.size(); first += kBatch) {
        writer.append(session.subspan(first, kBatch));
        writer.append(StoredEvent{0, 50, "batch"});
        writer.flush();
        const std::uint64_t safe = first + kBatch;
        if (write(ends[1], &safe, sizeof safe) != sizeof safe) break;
      }
      pause();
      _exit(1);
    }
    close(ends[1]);
    told_ = ends[0];
  }
  ~WriterProcess() {
    kill();
    close(told_);
  }

  /// Waits until `rows` rows are safe.
  void wait_for(std::uint64_t rows) {
    while (safe_ < rows && ::read(told_, &safe_, sizeof safe_) == sizeof safe_) {
    }
  }

  void kill() {
    if (process_ <= 0) return;
    ::kill(process_, SIGKILL);
    waitpid(process_, nullptr, 0);
    process_ = -1;
  }

  /// Kills the process and returns the number of rows that were safe at that time.
  std::uint64_t safe_at_death() {
    kill();
    while (::read(told_, &safe_, sizeof safe_) == sizeof safe_) {
    }
    return safe_;
  }

 private:
  pid_t process_ = -1;
  int told_ = -1;
  std::uint64_t safe_ = 0;
};

TEST(KilledWriter, LosesNothingThatWasFlushedAndInventsNothing) {
  const std::vector<Sample> session = random_session(1, 200'000, {});
  std::mt19937 random(1);
  for (int i = 0; i < 12; ++i) {
    const TempFolder folder;
    const std::string file = folder / "a.h5";
    WriterProcess writer(file, session, i % 2 == 0 ? 100 : 2048);
    writer.wait_for(kBatch * (1 + random() % 40));
    usleep(static_cast<useconds_t>(random() % 3000));  // any time: during a flush or between two
    const std::uint64_t safe = writer.safe_at_death();

    const std::string before = read_bytes(file);
    const RecordingReader reader(file);
    EXPECT_FALSE(reader.header().complete);
    EXPECT_GE(reader.rows(), safe);
    ASSERT_LE(reader.rows(), safe + kBatch);
    expect_same(reader.read(0, reader.rows()), std::span(session).first(reader.rows()));
    EXPECT_GE(reader.events().size(), safe / kBatch);
    for (const Finding& finding : check_recording(file))
      EXPECT_NE(finding.severity, Severity::problem) << finding.where << ": " << finding.what;
    EXPECT_TRUE(read_bytes(file) == before) << "reading changed the file";
  }
}

TEST(LiveReader, SeesDataFlushedAfterItOpenedTheFile) {
  const std::vector<Sample> session = random_session(2, 1000, {});
  const TempFolder folder;
  WriterProcess writer(folder / "a.h5", session, 100);
  writer.wait_for(kBatch);
  RecordingReader reader(folder / "a.h5");
  EXPECT_GE(reader.rows(), kBatch);
  writer.wait_for(session.size());
  reader.refresh();
  ASSERT_EQ(reader.rows(), session.size());
  expect_same(reader.read(0, session.size()), session);
  EXPECT_EQ(reader.events().size(), session.size() / kBatch);
  EXPECT_FALSE(reader.header().complete);
}

/// Limits the file size of this process, so that files cannot grow, as on a full disk.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) {
    std::signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit limited{bytes, before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limited);
  }
  ~FileSizeLimit() { setrlimit(RLIMIT_FSIZE, &before_); }
  FileSizeLimit(const FileSizeLimit&) = delete;
  FileSizeLimit& operator=(const FileSizeLimit&) = delete;

 private:
  rlimit before_{};
};

/// Appends until the writer throws, and returns its message.
std::string append_until_refused(RecordingWriter& writer, std::span<const Sample> session) {
  try {
    for (std::size_t first = 0; first < session.size(); first += kBatch) {
      writer.append(session.subspan(first, kBatch));
      writer.flush();
    }
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), Error::Kind::fault);
    return error.what();
  }
  return "never refused";
}

TEST(FullDisk, EndsTheRecordingInGoodOrderWithEverySampleInIt) {
  const std::vector<Sample> session = random_session(3, 60'000, {});
  for (const rlim_t limit : {3'000'000U, 4'100'000U}) {
    const TempFolder folder;
    const std::string file = folder / "a.h5";
    std::uint64_t rows = 0;
    {
      const FileSizeLimit full(limit);
      RecordingWriter writer(file, {}, {}, {.storage = {.rows_per_chunk = 100}});
      const std::string message = append_until_refused(writer, session);
      rows = writer.rows();
      EXPECT_EQ(message, file + ": recording stopped after " + std::to_string(rows) +
                             " samples: files of this process may have " + std::to_string(limit) +
                             " bytes at most (ulimit -f)");
      for (const auto& call :
           std::vector<std::function<void()>>{[&] { writer.append(session); }, [&] { writer.append(StoredEvent{}); },
                                              [&] { writer.flush(); }, [&] { writer.finish(); }})
        expect_error(call, Error::Kind::fault, {message});
    }
    const RecordingReader reader(file);
    ASSERT_EQ(reader.rows(), rows);
    EXPECT_GT(rows, 1000U);
    EXPECT_FALSE(reader.header().complete);
    expect_same(reader.read(0, rows), std::span(session).first(rows));
  }
}

TEST(FullDisk, RefusesANewRecordingWithoutLeavingOne) {
  const TempFolder folder;
  for (const rlim_t limit : {0U, 1000U, 100'000U, 2'000'000U}) {
    const FileSizeLimit full(limit);
    expect_error([&] { RecordingWriter(folder / "a.h5", {}, {}, {}); }, Error::Kind::input,
                 {folder / "a.h5" + ": files of this process may have " + std::to_string(limit) + " bytes at most"});
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

/// Replaces a file that HDF5 has open by a device that rejects every write.
void break_disk_under(const std::string& file) {
  const int refuses = open("/dev/full", O_RDWR);
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    std::error_code error;
    if (std::filesystem::read_symlink(entry.path(), error) != file) continue;
    dup2(refuses, std::stoi(entry.path().filename()));
    break;
  }
  close(refuses);
}

TEST(BrokenDisk, EndsTheRecordingWithAnErrorAndKeepsFlushedData) {
  const std::vector<Sample> session = random_session(4, 5000, {});
  for (const std::size_t flushed : {0U, 50U, 450U, 3000U}) {
    const TempFolder folder;
    const std::string file = folder / "a.h5";
    {
      RecordingWriter writer(file, {}, {}, {.storage = {.rows_per_chunk = 100}});
      if (flushed > 0) {
        writer.append(std::span(session).first(flushed));
        writer.flush();
      }
      break_disk_under(std::filesystem::canonical(file));
      const std::string message = append_until_refused(writer, std::span(session).subspan(flushed));
      EXPECT_NE(message.find(file + ": recording stopped after "), std::string::npos) << message;
      EXPECT_NE(message.find("No space left on device"), std::string::npos) << message;
      expect_error([&] { writer.finish(); }, Error::Kind::fault, {message});
    }
    const RecordingReader reader(file);
    EXPECT_FALSE(reader.header().complete);
    ASSERT_EQ(reader.rows(), flushed);
    expect_same(reader.read(0, flushed), std::span(session).first(flushed));
  }
}

/// Opens a recording with HDF5 itself and calls `use(dataset, column)` for each of its columns.
template <class Use>
void for_each_dataset(const std::string& file, unsigned flags, const Use& use) {
  const hid_t opened = H5Fopen(file.c_str(), flags, H5P_DEFAULT);
  ASSERT_GE(opened, 0);
  for (const layout::Column& column : layout::columns()) {
    if (H5Lexists(opened, column.path().c_str(), H5P_DEFAULT) <= 0) continue;
    const hid_t dataset = H5Dopen2(opened, column.path().c_str(), H5P_DEFAULT);
    use(dataset, column);
    H5Dclose(dataset);
  }
  H5Fclose(opened);
}

TEST(GrownButNotFilled, RowsWithoutATimeAreLeftOut) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  const std::vector<Sample> session = random_session(7, 350, {});
  write_recording(file, session, {}, {}, {{0.1, 50, "mark"}});
  for_each_dataset(file, H5F_ACC_RDWR, [](hid_t dataset, const layout::Column& column) {
    const hsize_t extent[] = {350 + 10'000, column.width};
    H5Dset_extent(dataset, extent);
  });
  const RecordingReader reader(file);
  ASSERT_EQ(reader.rows(), 350U);
  expect_same(reader.read(0, 10'350), session);
}

TEST(KilledWriter, LeavesNothingWrongIfItsOverviewLagsBehind) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  // The fastest movement spans the end of the rows in /overview.
  std::vector<Sample> session(9000);
  for (std::size_t i = 0; i < session.size(); ++i) {
    session[i].tick = i;
    session[i].time_ns = static_cast<std::int64_t>(i) * 1'000'000;
    session[i].position = Vec3(i < 8192 ? 0 : 0.01, 0, 0);
  }
  const pid_t child = fork();
  if (child == 0) {
    RecordingWriter writer(file, {}, {}, {});
    writer.append(session);
    writer.flush();
    _exit(0);
  }
  waitpid(child, nullptr, 0);
  ASSERT_EQ(RecordingReader(file).rows(), session.size());
  for (const Finding& finding : check_recording(file))
    EXPECT_NE(finding.severity, Severity::problem) << finding.where << ": " << finding.what;
}

TEST(RecordingWriter, FillsTimeLastAndTheRestOfAChunkWithFillValues) {
  const TempFolder folder;
  {
    RecordingWriter writer(folder / "a.h5", {}, {}, {});  // each chunk has its own pages, in the order of writing
    writer.append(random_session(8, 50, {}));
    writer.finish();
  }
  haddr_t last = 0;
  std::string written_last;
  for_each_dataset(folder / "a.h5", H5F_ACC_RDONLY, [&](hid_t dataset, const layout::Column& column) {
    const hsize_t offset[] = {0, 0};
    unsigned filters = 0;
    haddr_t address = 0;
    hsize_t size = 0;
    H5Dget_chunk_info_by_coord(dataset, offset, &filters, &address, &size);
    if (address > last) written_last = column.name;
    last = std::max(last, address);
    if (column.element != layout::Element::float64) return;
    std::vector<double> chunk(size / sizeof(double));
    H5Dread_chunk(dataset, H5P_DEFAULT, offset, &filters, chunk.data());
    EXPECT_FALSE(std::isnan(chunk[50 * column.width - 1])) << column.name;
    for (std::size_t i = 50 * column.width; i < chunk.size(); ++i) EXPECT_TRUE(std::isnan(chunk[i])) << column.name;
  });
  EXPECT_EQ(written_last, "time");
}

TEST(RecordingWriter, KeepsItsAttributesInTheObjectHeader) {
  const TempFolder folder;
  write_recording(folder / "a.h5", {});
  const hid_t file = H5Fopen((folder / "a.h5").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  H5O_info_t info{};
  ASSERT_GE(H5Oget_info2(file, &info, H5O_INFO_NUM_ATTRS | H5O_INFO_META_SIZE), 0);
  H5Fclose(file);
  EXPECT_EQ(info.num_attrs, 22U);
  EXPECT_EQ(info.meta_size.attr.index_size, 0U);
  EXPECT_EQ(info.meta_size.attr.heap_size, 0U);
}

/// Reads everything in a file. An Error is acceptable, any other exception is not.
void read_whatever_it_is(const std::string& file) {
  try {
    const RecordingReader reader(file);
    for (std::uint64_t first = 0; first < reader.rows(); first += 10'000) static_cast<void>(reader.read(first, 10'000));
    static_cast<void>(reader.events());
  } catch (const Error&) {
  }
  try {
    check_recording(file);
  } catch (const Error&) {
  }
}

TEST(CutFile, IsReadOrRefusedAtEveryLength) {
  const TempFolder folder;
  write_recording(folder / "whole.h5", random_session(5, 350, {}), {}, {}, {{0.1, 50, "mark"}});
  const std::string whole = read_bytes(folder / "whole.h5");
  for (std::size_t length = 0; length < whole.size(); length += 1 + whole.size() / 97) {
    const std::string file = folder.write("cut.h5", std::string_view(whole).substr(0, length));
    expect_error([&] { RecordingReader reader(file); }, Error::Kind::input, {file + ": "});
    read_whatever_it_is(file);
  }
}

// ------------------------------------------------------------------------------------------------------ flipped bytes

struct Kind {
  const char* name;
  RecordingColumns columns;
  Storage storage;
  bool in_parts = false;
  std::size_t touched = 1;  ///< Rows that one byte may change: one, or a whole chunk if it is rounded.
};

class FlippedBytes : public testing::TestWithParam<Kind> {};
constexpr std::size_t kFlippedRows = 80;
const RecordingColumns kEveryColumn{.orientation = true,
                                    .torque = true,
                                    .force_measured = true,
                                    .reference = true,
                                    .guidance = true,
                                    .tunnel = true,
                                    .reference_orientation = true,
                                    .gains = true};
INSTANTIATE_TEST_SUITE_P(
    Of, FlippedBytes,
    testing::Values(
        Kind{"Plain", {}, {.rows_per_chunk = 32}}, Kind{"EveryColumn", kEveryColumn, {.rows_per_chunk = 32}},
        Kind{"FirstPart", {}, {.rows_per_chunk = 32}, true}, Kind{"Packed", {}, {.deflate = 6, .rows_per_chunk = 32}},
        Kind{"Rounded", {}, {.precision = parse_precision("1um,1mN,1mm/s"), .rows_per_chunk = 32}, false, 32},
        Kind{"RoundedAndPacked",
             {},
             {.deflate = 1, .precision = parse_precision("1um,1mN,1mm/s"), .rows_per_chunk = 32}}),
    [](const auto& instance) { return instance.param.name; });

/// The whole content of a file.
struct Content {
  explicit Content(const std::string& file) {
    const RecordingReader reader(file);
    samples = reader.read(0, reader.rows());
    for (const StoredEvent& event : reader.events())
      events.push_back(fmt::format("{} {} {}", event.time, event.code, event.text));
    const RecordingHeader h = reader.header();
    header = fmt::format("{} {} {} {} {} {} {} {} {} {} {}", h.format_version, h.uuid, h.created, h.title, h.rate_hz,
                         h.clock, h.complete, h.config.dump(), h.max_force_n, h.part, h.part_of);
    for (const auto& [key, value] : h.meta) header += key + value;
    (void)reader.overview();
  }
  std::vector<Sample> samples;
  std::vector<std::string> events;
  std::string header;
};

bool is_detected(const std::string& file) {
  for (const Finding& finding : check_recording(file))
    if (finding.severity != Severity::note) return true;
  return false;
}

TEST_P(FlippedBytes, AreFoundOrChangeOnlyWhatTheyTouch) {
  const TempFolder folder;
  RecordingHeader header;
  header.title = "a title";
  header.config = {{"kp", 500}};
  header.meta = {{"group", "a"}};
  {
    RecordingWriter writer(folder / "whole.h5", header, GetParam().columns,
                           {.storage = GetParam().storage, .in_parts = GetParam().in_parts});
    const std::vector<Sample> session = random_session(6, 2 * kFlippedRows, GetParam().columns);
    writer.append(std::span(session).first(kFlippedRows));
    writer.append(StoredEvent{0.01, 50, "mark"});
    writer.append(StoredEvent{0.02, 10, "overrun"});
    if (GetParam().in_parts) {
      writer.start_part();
      writer.append(std::span(session).subspan(kFlippedRows));
    }
    writer.finish();
  }
  if (GetParam().in_parts)
    std::filesystem::copy_file(part_file(folder / "whole.h5", 2), part_file(folder / "flipped.h5", 2));
  const Content whole(folder / "whole.h5");
  ASSERT_EQ(whole.samples.size(), GetParam().in_parts ? 2 * kFlippedRows : kFlippedRows);
  const std::string bytes = read_bytes(folder / "whole.h5");

  // By default some 600 bytes are flipped. HAPTRACE_EVERY_BYTE flips every byte, which takes minutes.
  std::mt19937 random(std::random_device{}());
  const std::size_t step = std::getenv("HAPTRACE_EVERY_BYTE") != nullptr ? 1 : 1 + bytes.size() / 600;
  std::size_t found = 0, harmless = 0, changed = 0;
  for (std::size_t at = random() % step; at < bytes.size(); at += step) {
    std::string flipped = bytes;
    flipped[at] ^= static_cast<char>(1U << (random() % 8));
    if (random() % 4 == 0) flipped[at] = static_cast<char>(random());
    SCOPED_TRACE(fmt::format("byte {}: {:#x} for {:#x}", at, static_cast<unsigned char>(flipped[at]),
                             static_cast<unsigned char>(bytes[at])));
    const std::string file = folder.write("flipped.h5", flipped);
    std::optional<Content> read;
    try {
      read.emplace(file);
      if (is_detected(file)) read.reset();
    } catch (const Error&) {
      read.reset();
    }
    if (!read) {
      ++found;
      continue;
    }
    EXPECT_EQ(read->header, whole.header);
    ASSERT_EQ(read->events.size(), whole.events.size());
    std::size_t places = 0;
    for (std::size_t i = 0; i < whole.events.size(); ++i) places += read->events[i] != whole.events[i] ? 1 : 0;
    EXPECT_LE(places, 1U) << "events that changed";
    ASSERT_EQ(read->samples.size(), whole.samples.size());
    for (const layout::Column& column : layout::columns()) {
      const std::string a = bytes_of(column, read->samples), b = bytes_of(column, whole.samples);
      if (a == b) continue;
      ++places;
      std::size_t first = a.size(), last = 0;
      for (std::size_t i = 0; i < a.size(); ++i) {
        if (a[i] == b[i]) continue;
        first = std::min(first, i / column.row_bytes());
        last = i / column.row_bytes();
      }
      EXPECT_LT(last - first, GetParam().touched) << column.path() << " rows " << first << " to " << last;
    }
    EXPECT_LE(places, 1U) << "places that changed";
    ++(places > 0 ? changed : harmless);
  }
  std::cout << found << " found, " << changed << " changed a value, " << harmless << " changed nothing\n";
  EXPECT_GT(found, 50U);
}

}  // namespace
}  // namespace haptrace
