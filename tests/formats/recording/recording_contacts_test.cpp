// The table of contacts and the scene in a recording: kept to the bit by every way in and out.
#include "formats/recording/crash_recovery.h"
#include "formats/recording/recording.h"
#include "formats/recording/recording_stream.h"
#include "tests/formats/support.h"

#include <cstdio>
#include <fmt/format.h>

namespace haptrace {
namespace {

constexpr RecordingColumns kTouching{.contacts = true};

/// Returns up to three contacts for each of some ticks of a session.
std::vector<ContactSample> random_contacts(unsigned seed, std::size_t ticks) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> number(-1, 1);
  std::vector<ContactSample> contacts;
  for (std::size_t tick = 0; tick < ticks; ++tick)
    for (std::uint32_t object = 0; object < random() % 4; ++object) {
      ContactSample& contact = contacts.emplace_back();
      contact.tick = tick;
      contact.time_ns = static_cast<std::int64_t>(tick) * 1'000'000;
      contact.object = object;
      contact.proxy = Vec3(number(random), number(random), number(random));
      contact.normal = Vec3(number(random), number(random), number(random)).normalized();
      contact.depth = 1e-3 * number(random);
      contact.force = Vec3(number(random), number(random), number(random));
    }
  return contacts;
}

RecordedScene some_scene() {
  return {.text = R"({"objects": [{"kind": "mesh", "file": "cup.obj"}]})" + std::string(100'000, ' '),
          .objects = {"cup", "floor", "ball", "w\u00e4nde"},
          .files = {{"parts/cup.obj", "xxh3:0123456789abcdef"}, {"/old/absolute.obj", "xxh3:0000000000000000"}},
          .folder = "/home/w\u00e4nde"};
}

void write_touches(const std::string& file, std::span<const Sample> session, std::span<const ContactSample> contacts,
                   const RecordingWriter::Options& options = {.storage = {.rows_per_chunk = 100}}) {
  RecordingHeader header;
  header.scene = some_scene();
  RecordingWriter writer(file, header, kTouching, options);
  writer.append(session);
  writer.append(contacts);
  writer.finish();
}

void expect_same_contacts(const std::vector<ContactSample>& found, std::span<const ContactSample> expected) {
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    ASSERT_EQ(found[i].tick, expected[i].tick);
    ASSERT_EQ(found[i].time_ns, expected[i].time_ns);
    ASSERT_EQ(found[i].object, expected[i].object);
    ASSERT_EQ(found[i].proxy, expected[i].proxy);
    ASSERT_EQ(found[i].normal, expected[i].normal);
    ASSERT_EQ(found[i].depth, expected[i].depth);
    ASSERT_EQ(found[i].force, expected[i].force);
  }
}

void expect_conforming(const std::string& file) {
  for (const Finding& finding : check_recording(file)) ADD_FAILURE() << finding.where << ": " << finding.what;
}

TEST(RecordedContacts, AreKeptToTheBitWithTheirScene) {
  const TempFolder folder;
  for (const bool old : {false, true}) {
    const std::string file = folder / (old ? "old.h5" : "new.h5");
    const auto session = random_session(1, 3000, {});
    const auto contacts = random_contacts(1, session.size());
    write_touches(file, session, contacts, {.storage = {.rows_per_chunk = 100}, .for_hdf5_1_8 = old});
    const RecordingReader reader(file);
    EXPECT_TRUE(reader.columns().contacts);
    ASSERT_EQ(reader.contact_rows(), contacts.size());
    expect_same_contacts(reader.contacts(0, contacts.size()), contacts);
    const RecordedScene scene = reader.header().scene;
    EXPECT_EQ(scene.text, some_scene().text);
    EXPECT_EQ(scene.objects, some_scene().objects);
    EXPECT_EQ(scene.files, some_scene().files);
    EXPECT_EQ(scene.folder, some_scene().folder);
    expect_conforming(file);
  }
}

TEST(RecordedContacts, AreFoundByTheirTime) {
  const TempFolder folder;
  const auto session = random_session(2, 500, {});
  const auto contacts = random_contacts(2, session.size());
  write_touches(folder / "a.h5", session, contacts);
  const RecordingReader reader(folder / "a.h5");
  for (const std::int64_t time : {std::int64_t{-5}, std::int64_t{0}, contacts[77].time_ns, contacts[77].time_ns + 1,
                                  contacts.back().time_ns, contacts.back().time_ns + 1}) {
    const auto first =
        std::find_if(contacts.begin(), contacts.end(), [&](const auto& contact) { return contact.time_ns >= time; });
    EXPECT_EQ(reader.contact_at(time), static_cast<std::uint64_t>(first - contacts.begin())) << time;
  }
}

TEST(RecordedContacts, AreAbsentFromARecordingWithoutAScene) {
  const TempFolder folder;
  write_recording(folder / "a.h5", random_session(3, 10, {}));
  const RecordingReader reader(folder / "a.h5");
  EXPECT_FALSE(reader.columns().contacts);
  EXPECT_EQ(reader.contact_rows(), 0U);
  EXPECT_TRUE(reader.contacts(0, 10).empty());
  EXPECT_TRUE(reader.header().scene.empty());
}

TEST(RecordedContacts, SpanThePartsOfARecording) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  const auto session = random_session(4, 900, {});
  const auto contacts = random_contacts(4, session.size());
  {
    RecordingWriter writer(file, {}, kTouching, {.storage = {.rows_per_chunk = 64}, .in_parts = true});
    std::span<const ContactSample> rest = contacts;
    for (std::size_t first = 0; first < session.size(); first += 300) {
      if (first > 0) writer.start_part();
      writer.append(std::span(session).subspan(first, 300));
      const auto end = std::find_if(rest.begin(), rest.end(), [&](const auto& c) { return c.tick >= first + 300; });
      writer.append(rest.first(static_cast<std::size_t>(end - rest.begin())));
      rest = rest.subspan(static_cast<std::size_t>(end - rest.begin()));
    }
    writer.finish();
  }
  const RecordingReader reader(file);
  EXPECT_EQ(reader.parts(), 3U);
  expect_same_contacts(reader.contacts(0, 1'000'000), contacts);
  expect_same_contacts(reader.contacts(contacts.size() / 2, 5), std::span(contacts).subspan(contacts.size() / 2, 5));
  expect_conforming(file);
}

TEST(RecordedContacts, AreCutWithTheirSamplesAndSurviveACompression) {
  const TempFolder folder;
  const auto session = random_session(5, 20'000, {});
  const auto contacts = random_contacts(5, session.size());
  write_touches(folder / "a.h5", session, contacts);
  const auto convert = [&](const std::string& to, std::unique_ptr<RecordingSource> source) {
    SinkOptions options;
    options.hdf5.storage.deflate = 6;
    const auto sink = create_sink(to, source->header(), source->columns(), source->events(), options);
    copy(*source, *sink);
    sink->finish();
  };
  convert(folder / "all.h5", open_source(folder / "a.h5"));
  expect_same_contacts(RecordingReader(folder / "all.h5").contacts(0, 1'000'000), contacts);
  expect_conforming(folder / "all.h5");

  convert(folder / "cut.h5", cut(open_source(folder / "a.h5"), 9, 15.5));
  std::vector<ContactSample> kept;
  for (ContactSample contact : contacts) {
    if (contact.tick < 9000 || contact.tick > 15'500) continue;
    contact.time_ns -= 9'000'000'000;
    kept.push_back(contact);
  }
  const RecordingReader reader(folder / "cut.h5");
  expect_same_contacts(reader.contacts(0, 1'000'000), kept);
  EXPECT_EQ(reader.header().scene.objects, some_scene().objects);
  expect_conforming(folder / "cut.h5");
}

TEST(RecordedContacts, AreRecoveredAfterTheWriterDied) {
  const TempFolder folder;
  const std::string file = folder / "a.h5";
  const auto session = random_session(6, 700, {});
  const auto contacts = random_contacts(6, session.size());
  {
    RecordingWriter writer(file, {}, kTouching, {.storage = {.rows_per_chunk = 100}});
    writer.append(session);
    writer.append(contacts);
  }
  EXPECT_FALSE(RecordingReader(file).header().complete);
  const Recovery recovery = recover_recording(file);
  EXPECT_FALSE(recovery.damaged);
  const RecordingReader reader(file);
  EXPECT_TRUE(reader.header().complete);
  expect_same_contacts(reader.contacts(0, 1'000'000), contacts);
  expect_conforming(file);
}

TEST(RecordedContacts, AreCheckedAgainstTheRulesAndTheirChecksum) {
  const TempFolder folder;
  const auto session = random_session(7, 50, {});
  std::vector<ContactSample> contacts = random_contacts(7, session.size());
  ASSERT_GT(contacts.size(), 10U);
  contacts[2].normal *= 2;
  contacts[4].object = 9;
  contacts[6].proxy = nan3();
  contacts[8].tick = 0;
  write_touches(folder / "bad.h5", session, contacts);
  std::vector<std::string> found;
  for (const Finding& finding : check_recording(folder / "bad.h5")) found.push_back(finding.where + " " + finding.what);
  const auto told = [&](const char* row, const char* what) {
    return std::any_of(found.begin(), found.end(), [&](const std::string& text) {
      return text.find(row) != std::string::npos && text.find(what) != std::string::npos;
    });
  };
  EXPECT_TRUE(told("/contacts[2]", "no unit vector"));
  EXPECT_TRUE(told("/contacts[4]", "names an object"));
  EXPECT_TRUE(told("/contacts[6]", "not finite"));
  EXPECT_TRUE(told("/contacts[8]", "does not come after"));

  // A byte of a force changes behind the back of the checksum.
  write_touches(folder / "good.h5", session, random_contacts(8, session.size()));
  std::FILE* const file = std::fopen((folder / "good.h5").c_str(), "r+b");
  ASSERT_NE(file, nullptr);
  const double sought = random_contacts(8, session.size())[3].force.x();
  std::string bytes(1 << 22, '\0');
  bytes.resize(std::fread(bytes.data(), 1, bytes.size(), file));
  const std::size_t at = bytes.find(std::string(reinterpret_cast<const char*>(&sought), sizeof sought));
  ASSERT_NE(at, std::string::npos);
  std::fseek(file, static_cast<long>(at), SEEK_SET);
  std::fputc(bytes[at] ^ 1, file);
  std::fclose(file);
  const auto findings = check_recording(folder / "good.h5");
  ASSERT_EQ(findings.size(), 1U);
  EXPECT_NE(findings[0].where.find("/contacts"), std::string::npos);
}

TEST(RecordedContacts, AreReadByH5py) {
  const TempFolder folder;
  const auto session = random_session(9, 40, {});
  const auto contacts = random_contacts(9, session.size());
  write_touches(folder / "a.h5", session, contacts);
  const std::string script = folder.write("read.py", R"(
import h5py, json, sys
with h5py.File(sys.argv[1]) as f:
    c = f["/contacts"]
    print(len(c), sorted(c.dtype.names), json.loads(f["/scene"].attrs["objects"])[3], f["/scene"].attrs["file:parts/cup.obj"].decode())
    for row in c[:]: print(row["tick"], row["object"], float(row["depth"]).hex(), *(float(v).hex() for v in row["force"]))
)");
  std::FILE* const out =
      popen(fmt::format("PYTHONIOENCODING=utf-8 {} {} {} 2>&1", HAPTRACE_PYTHON, script, folder / "a.h5").c_str(), "r");
  ASSERT_NE(out, nullptr);
  std::string text(1 << 16, '\0');
  text.resize(std::fread(text.data(), 1, text.size(), out));
  EXPECT_EQ(pclose(out), 0) << text;
  std::string expected = fmt::format(
      "{} ['depth', 'force', 'normal', 'object', 'proxy', 'tick', 'time'] w\u00e4nde xxh3:0123456789abcdef\n",
      contacts.size());
  EXPECT_TRUE(text.starts_with(expected)) << text.substr(0, 200);
  char line[200];
  const ContactSample& last = contacts.back();
  std::snprintf(line, sizeof line, "%llu %u ", static_cast<unsigned long long>(last.tick), last.object);
  EXPECT_NE(text.rfind(line), std::string::npos);
}

}  // namespace
}  // namespace haptrace
