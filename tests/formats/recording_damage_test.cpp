// What happens to recordings: the process is killed, the disk is full or gone, files are cut, bytes flip.
#include "formats/recording.h"
#include "tests/formats/support.h"

#include <csignal>
#include <fcntl.h>
#include <hdf5.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

namespace haptrace {
namespace {

constexpr std::size_t kBatch = 50;  // rows between two flushes

/// A process that appends the session again and again, flushing every kBatch rows, and tells how many rows are safe.
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
    while (safe_ < rows && read(told_, &safe_, sizeof safe_) == sizeof safe_) {
    }
  }

  void kill() {
    if (process_ <= 0) return;
    ::kill(process_, SIGKILL);
    waitpid(process_, nullptr, 0);
    process_ = -1;
  }

  /// The rows that were safe when it died.
  std::uint64_t safe_at_death() {
    kill();
    while (read(told_, &safe_, sizeof safe_) == sizeof safe_) {
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
    usleep(static_cast<useconds_t>(random() % 3000));  // any moment will do: in the middle of a flush, or between two
    const std::uint64_t safe = writer.safe_at_death();

    const std::string before = read_bytes(file);
    const RecordingReader reader(file);
    EXPECT_FALSE(reader.header().complete);
    EXPECT_GE(reader.rows(), safe);
    ASSERT_LE(reader.rows(), safe + kBatch);
    expect_same(reader.read(0, reader.rows()), std::span(session).first(reader.rows()));
    EXPECT_GE(reader.events().size(), safe / kBatch);
    for (const Finding& finding : check_recording(file))
      EXPECT_NE(finding.severity, Finding::Severity::error) << finding.where << ": " << finding.what;
    EXPECT_TRUE(read_bytes(file) == before) << "reading changed the file";
  }
}

TEST(LiveReader, SeesWhatWasFlushedSinceItOpenedTheFile) {
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

/// A limit of this process on the length of files, which refuses to grow them as a full disk does.
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

/// Appends until the writer refuses, and answers its message.
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

/// Puts a device that refuses every write in place of a file that HDF5 has open.
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

TEST(BrokenDisk, EndsTheRecordingWithAnErrorAndKeepsWhatWasFlushed) {
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

/// Calls `use(dataset, column)` for every column of a recording, opened with HDF5 itself.
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

TEST(RecordingWriter, FillsTimeLastAndTheRestOfAChunkWithFillValues) {
  const TempFolder folder;
  write_recording(folder / "a.h5", random_session(8, 150, {}));
  haddr_t last = 0;
  std::string written_last;
  for_each_dataset(folder / "a.h5", H5F_ACC_RDONLY, [&](hid_t dataset, const layout::Column& column) {
    const hsize_t offset[] = {100, 0};
    unsigned filters = 0;
    haddr_t address = 0;
    hsize_t size = 0;
    H5Dget_chunk_info_by_coord(dataset, offset, &filters, &address, &size);
    if (address > last) written_last = column.name;
    last = std::max(last, address);
    std::vector<double> chunk(size / sizeof(double));
    H5Dread_chunk(dataset, H5P_DEFAULT, offset, &filters, chunk.data());
    if (column.element != layout::Element::float64) return;
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
  EXPECT_EQ(info.num_attrs, 19U);
  EXPECT_EQ(info.meta_size.attr.index_size, 0U);
  EXPECT_EQ(info.meta_size.attr.heap_size, 0U);
}

/// Reads everything that a file offers. Any Error will do; anything else that comes out of it will not.
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

TEST(FlippedBytes, AreReadOrRefused) {
  const TempFolder folder;
  write_recording(folder / "whole.h5", random_session(6, 350, {}), {}, {}, {{0.1, 50, "mark"}});
  const std::string whole = read_bytes(folder / "whole.h5");
  std::mt19937 random(6);
  for (int i = 0; i < 300; ++i) {
    std::string flipped = whole;
    // Most of the file is values; its structure is at the front.
    const std::size_t range = i % 2 == 0 ? whole.size() : 8000;
    for (int n = 0; n <= i % 3; ++n) flipped[random() % range] ^= static_cast<char>(1U << (random() % 8));
    read_whatever_it_is(folder.write("flipped.h5", flipped));
  }
}

}  // namespace
}  // namespace haptrace
