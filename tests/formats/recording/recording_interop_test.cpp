// Interoperability of recordings: h5py reads them, also during writing; haptrace reads files of h5py; Octave and h5dump
// open them.
#include "formats/recording/recording.h"
#include "tests/formats/support.h"

#include <array>
#include <cstdio>
#include <fmt/format.h>

namespace haptrace {
namespace {

/// Another program that runs beside the test. Its output is read line by line.
class Program {
 public:
  explicit Program(const std::string& command) : stream_(popen((command + " 2>&1").c_str(), "r")) {}
  ~Program() {
    if (stream_ != nullptr) pclose(stream_);
  }
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  /// Returns the next line without its end; empty at the end of the output.
  std::string line() {
    std::array<char, 4096> buffer{};
    if (std::fgets(buffer.data(), buffer.size(), stream_) == nullptr) return {};
    const std::string text(buffer.data());
    return text.substr(0, text.find('\n'));
  }

  /// Returns the remaining output up to an empty line. Most tests expect none.
  std::string rest() {
    std::string all, next;
    while (!(next = line()).empty()) all += next + "\n";
    return all;
  }

  /// Waits for the program to end and returns its exit status; 0 is success.
  int end() { return pclose(std::exchange(stream_, nullptr)); }

 private:
  std::FILE* stream_;
};

/// A Python program that imports h5py and numpy; `script` may use `folder`.
class Python {
 public:
  explicit Python(const TempFolder& folder, const std::string& script)
      : program_(
            fmt::format("{} {} {}", HAPTRACE_PYTHON,
                        folder.write("script.py", "import sys, h5py, numpy as np\nfolder = sys.argv[1]\n" + script),
                        folder.path())) {}
  Program* operator->() { return &program_; }

 private:
  Program program_;
};

TEST(H5py, ReadsTheSameBytesInEveryColumn) {
  const TempFolder folder;
  const RecordingColumns columns{true, true, true, true, true, true, true, true, true};
  const std::vector<Sample> session = random_session(1, 333, columns);
  RecordingHeader header;
  header.title = "Linie \xC3\xBC";
  header.config = {{"kp", 800}};
  write_recording(folder / "a.h5", session, columns, header, {{0.25, 50, "mark \xC3\xBC"}});
  for (const layout::Column& column : layout::columns())
    static_cast<void>(folder.write(std::string(column.name) + ".bin", bytes_of(column, session)));
  Python python(folder, R"(
import json, os
with h5py.File(folder + '/a.h5', 'r') as f:
    names = [n[:-4] for n in os.listdir(folder) if n.endswith('.bin')]
    assert sorted(names) == sorted(f['samples']), list(f['samples'])
    for name in names:
        d = f['samples'][name]
        assert d[...].tobytes() == open(f'{folder}/{name}.bin', 'rb').read(), name
        assert d.chunks and d.maxshape[0] is None and d.attrs['units'] and d.attrs['description'], name
        assert d.dtype.kind != 'f' or np.isnan(d.fillvalue), name
    assert f['samples/position'].dtype == '<f8' and f['samples/tick'].dtype == '<u8'
    assert f['samples/latency'].dtype == '<f4' and f['samples/phase'].dtype == 'u1'
    assert f.attrs['format'] == b'haptrace-recording' and f.attrs['complete'] == 1
    assert f.attrs['title'].decode() == 'Linie \u00fc' and json.loads(f.attrs['config'])['kp'] == 800
    e = f['events']
    assert e.dtype.names == ('time', 'code', 'text') and e.dtype.itemsize == 140, e.dtype
    assert e[0]['time'] == 0.25 and e[0]['code'] == 50 and e[0]['text'].decode() == 'mark \u00fc'
)");
  EXPECT_EQ(python->rest(), "");
  EXPECT_EQ(python->end(), 0);
}

TEST(H5py, FollowsARecordingWhileItIsWritten) {
  const TempFolder folder;
  const std::vector<Sample> session = random_session(2, 1234, {});
  RecordingWriter writer(folder / "a.h5", {}, {}, {.storage = {.rows_per_chunk = 100}});
  Python python(folder, R"(
with h5py.File(folder + '/a.h5', 'r', swmr=True) as f:
    ticks, position = f['samples/tick'], f['samples/position']
    told = -1
    while told < 1234:
        ticks.refresh()
        position.refresh()
        n = min(len(ticks), len(position))
        if n == told:
            continue
        assert list(ticks[:n]) == list(range(n)) and np.isfinite(position[:n]).all()
        print(n, flush=True)
        told = n
)");
  for (std::size_t rows = 0; rows < session.size();) {
    const std::size_t count = std::min<std::size_t>(123, session.size() - rows);
    writer.append(std::span(session).subspan(rows, count));
    writer.flush();
    rows += count;
    std::string seen;
    while (seen != std::to_string(rows) && !(seen = python->line()).empty()) {
    }
    ASSERT_EQ(seen, std::to_string(rows)) << python->rest();
  }
  writer.finish();
  EXPECT_EQ(python->rest(), "");
  EXPECT_EQ(python->end(), 0);
}

TEST(H5py, WritesRecordingsThatWeRead) {
  const TempFolder folder;
  Python python(folder, R"(
with h5py.File(folder + '/a.h5', 'w') as f:
    f.attrs.update(format='haptrace-recording', format_version='1.7', rate_hz=500, clock='virtual', complete=1,
                   title='from \u00fc python', config='{"a": 1}')
    n = 20
    s = f.create_group('samples')
    s['time'] = np.arange(n) / 500                       # contiguous
    s['tick'] = np.arange(n)                             # int64
    for name in ('position', 'velocity', 'force'):
        s.create_dataset(name, data=np.arange(3 * n, dtype='f4').reshape(n, 3), compression='gzip', chunks=(7, 3))
    s['buttons'] = np.zeros(n, 'u1')
    s['phase'] = np.full(n, 2, '>i4')
    s['latency'] = np.full(n + 3, 1e-5)                  # longer than the others
    f['events'] = np.array([(0.01, 50, b'a mark')], dtype=[('time', 'f8'), ('code', 'i8'), ('text', 'S40')])
)");
  EXPECT_EQ(python->rest(), "");
  ASSERT_EQ(python->end(), 0);
  const RecordingReader reader(folder / "a.h5");
  EXPECT_EQ(reader.header().title, "from \xC3\xBC python");
  EXPECT_EQ(reader.header().config["a"], 1);
  EXPECT_EQ(reader.header().rate_hz, 500);
  EXPECT_TRUE(reader.header().complete);
  ASSERT_EQ(reader.rows(), 20U);
  const std::vector<Sample> samples = reader.read(0, 20);
  EXPECT_EQ(samples[7].time_ns, 14'000'000);
  EXPECT_EQ(samples[7].tick, 7U);
  EXPECT_EQ(samples[7].position, Vec3(21, 22, 23));
  EXPECT_EQ(samples[7].phase, Phase::run);
  EXPECT_TRUE(std::isnan(samples[7].progress));
  ASSERT_EQ(reader.events().size(), 1U);
  EXPECT_EQ(reader.events()[0].text, "a mark");
  EXPECT_EQ(reader.events()[0].code, 50);
}

TEST(Octave, ReadsSamplesAndEventsWithItsOwnLoad) {
  const TempFolder folder;
  const std::vector<Sample> session = random_session(4, 60, {});
  write_recording(folder / "a.h5", session, {}, {},
                  {{0.25, 1, "started"},
                   {0.5, 50,
                    "\xC3\x9C"
                    "bung 1"},
                   {0.75, 2, std::string(127, 'z')}});
  const std::string script = folder.write("read.m", fmt::format("f = load('{}', 'samples', 'event_list');\n"
                                                                "assert (size (f.samples.position), [3, 60]);\n"
                                                                "assert (f.samples.position(2, 5), {});\n"
                                                                "assert (f.event_list.time(:)', [0.25, 0.5, 0.75]);\n"
                                                                "assert (double (f.event_list.code(:)'), [1, 50, 2]);\n"
                                                                "t = cellstr (f.event_list.text);\n"
                                                                "assert (t{{1}}, 'started'); assert (t{{2}}, '\xC3\x9C"
                                                                "bung 1'); assert (numel (t{{3}}), 127);\n"
                                                                "printf ('%s\\n', 'all right');\n",
                                                                folder / "a.h5", session[4].position.y()));
  Program octave(fmt::format("{} --no-gui --no-history --quiet {}", HAPTRACE_OCTAVE, script));
  const std::string said = octave.rest();
  EXPECT_NE(said.find("all right"), std::string::npos) << said;
  // h5py reads the same events from the file.
  Python python(folder, R"(
with h5py.File(folder + '/a.h5', 'r') as f:
    e, l = f['events'][...], f['event_list']
    assert list(l['time']) == list(e['time']) and list(l['code']) == list(e['code'])
    assert list(l['text']) == list(e['text']), (l['text'][...], e['text'])
)");
  EXPECT_EQ(python->rest(), "");
  EXPECT_EQ(python->end(), 0);
}

TEST(H5dump, OpensAFinishedRecording) {
  const TempFolder folder;
  write_recording(folder / "a.h5", random_session(3, 50, {}));
  Program dump(fmt::format("{} -d /samples/tick -s 49 -c 1 {}", HAPTRACE_H5DUMP, folder / "a.h5"));
  EXPECT_NE(dump.rest().find("(49): 49"), std::string::npos);
  EXPECT_EQ(dump.end(), 0);
}

}  // namespace
}  // namespace haptrace
