#include "formats/convert/anonymise.h"

#include "tests/formats/support.h"

#include <gmock/gmock.h>

namespace haptrace {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::Not;

/// Writes a recording with the name Jane in every text field and returns its file name.
std::string personal(const TempFolder& folder) {
  RecordingHeader header;
  header.uuid = "jane-uuid";
  header.title = "a circle";
  header.subject = header.operator_name = header.notes = header.device_serial = "Jane";
  header.device_name = "sim:preset=falcon,mass=0.2,intent=/home/Jane/a.csv,serial=4711";
  header.software = "Jane's recorder";
  header.config = {{"verb", "play"},
                   {"kp", 500},
                   {"repeat", true},
                   {"clock", "virtual"},
                   {"file", "/home/Jane/circle.h5"},
                   {"record", "Jane.h5"},
                   {"serial", 12345},
                   {"gains", {{"kp", {1, 2, 3}}, {"author", "Jane"}}},
                   {"list", {"Jane", 1, "Jane"}},
                   {"subject", 4711},
                   {"meta", {4711, "patient=Jane"}},
                   {"tuned", {{"device_id", 4711}}},
                   {"device", "sim:preset=falcon,hand=relaxed,intent=/home/Jane/a.csv,seed=3,serial=99,label=Jane"}};
  header.meta = {{"patient", "Jane"}, {"ward", "Jane's"}};
  const std::string file = folder / "a.h5";
  write_recording(
      file, random_session(3, 100, {}), {}, header,
      {{0.01, 50, "Jane slipped"},
       {0.02, 10, "overrun: 3 ticks missed, woke 3.000 ms late"},
       {0.03, 51, "paused by Jane"},
       {0.04, 40, "repetition 2"},
       {0.05, 1234, "Jane"},
       {0.06, 50, "mark"},
       {0.07, 20, "force limited: 3 N requested by Jane"},
       {0.08, 33, "the device was lost: /dev/serial/by-id/Jane-4711"},
       {0.09, 50, "4711"},
       {0.10, 20, "force limited: 12.5 N asked, 8.9 N allowed"},
       {0.11, 26,
        "motors warm: 80 % of the heat at which the force is limited; at this force they reach it in 1e+06 s"},
       {0.12, 21, "continuous force limited to J\xe4ne N"}});
  return file;
}

TEST(Anonymise, LeavesNoTextThatAPersonWroteInAnyFormat) {
  const TempFolder folder;
  const std::string file = personal(folder);
  for (const char* name : {"b.h5", "b.csv", "b.jsonl"}) {
    const auto source = anonymise(open_source(file));
    const auto sink = create_sink(folder / name, source->header(), source->columns(), source->events(), {});
    EXPECT_EQ(copy(*source, *sink), 100U);
    sink->finish();
    EXPECT_THAT(read_bytes(folder / name), Not(HasSubstr("Jane"))) << name;
    EXPECT_THAT(read_bytes(folder / name), Not(HasSubstr("jane-uuid"))) << name;
    EXPECT_THAT(read_bytes(folder / name), Not(HasSubstr("4711"))) << name;
    EXPECT_THAT(read_bytes(folder / name), Not(HasSubstr("J\xe4ne"))) << name;
  }
  EXPECT_THAT(read_bytes(file), HasSubstr("Jane"));
}

TEST(Anonymise, KeepsNumbersChoicesSamplesAndTheTextsOfNumbers) {
  const TempFolder folder;
  const std::string file = personal(folder);
  const auto source = anonymise(open_source(file));
  const RecordingHeader& header = source->header();
  EXPECT_EQ(header.title, "a circle");
  EXPECT_EQ(header.device_name, "sim:preset=falcon,mass=0.2");
  EXPECT_EQ(header.config, nlohmann::json({{"verb", "play"},
                                           {"kp", 500},
                                           {"repeat", true},
                                           {"clock", "virtual"},
                                           {"gains", {{"kp", {1, 2, 3}}}},
                                           {"list", nlohmann::json::array({1})},
                                           {"tuned", nlohmann::json::object()},
                                           {"device", "sim:preset=falcon,hand=relaxed,seed=3"}}));
  EXPECT_EQ(header.uuid.size(), 36U);
  std::vector<std::string> texts;
  for (const StoredEvent& event : source->events()) texts.push_back(event.text);
  EXPECT_EQ(texts,
            (std::vector<std::string>{
                "mark", "overrun: 3 ticks missed, woke 3.000 ms late", "paused", "repetition 2", "event 1234", "mark",
                "event 20", "event 33", "mark", "force limited: 12.5 N asked, 8.9 N allowed",
                "motors warm: 80 % of the heat at which the force is limited; at this force they reach it in 1e+06 s",
                "event 21"}));
  expect_same(source->next(), random_session(3, 100, {}));
}

TEST(Anonymise, KeepsOnlyTheKindOfARealDeviceOrPlugIn) {
  const TempFolder folder;
  for (const auto& [name, kept] : {std::pair{"plugin:path=/home/Jane/libarm.so,participant=4711,mass=2", "plugin"},
                                   {"falcon:serial=A4711", "falcon"},
                                   {"falcon:emulated=true,hand=relaxed,port=3", "falcon:emulated=true,hand=relaxed"},
                                   {"inverse3:device_id=4711,url=ws://jane.example", "inverse3"},
                                   {"haply2diy:generation=gen2,port=/dev/ttyACM0", "haply2diy:generation=gen2"},
                                   {"replay:/home/Jane/a.h5", "replay"},
                                   {"sim", "sim"}}) {
    RecordingHeader header;
    header.device_name = name;
    header.config = {{"device", name}};
    write_recording(folder / "a.h5", random_session(3, 10, {}), {}, header);
    const auto source = anonymise(open_source(folder / "a.h5"));
    EXPECT_EQ(source->header().device_name, kept);
    EXPECT_EQ(source->header().config["device"], kept);
    std::filesystem::remove(folder / "a.h5");
  }
}

TEST(Anonymise, ReportsDroppedFieldsAndFieldsThatMayRevealAPerson) {
  const TempFolder folder;
  const AnonymiseReport report = anonymise(open_source(personal(folder)))->report();
  EXPECT_THAT(report.dropped,
              testing::UnorderedElementsAre("subject", "operator", "notes", "device_serial", "uuid", "meta.patient",
                                            "meta.ward", "config.file", "config.record", "config.serial",
                                            "config.gains.author", "config.list", "config.device", "config.subject",
                                            "config.meta", "config.tuned.device_id", "device_name", "software"));
  EXPECT_EQ(report.texts, 7U);
  EXPECT_THAT(report.kept, Contains("title"));
  EXPECT_THAT(report.kept, Contains("created"));

  write_recording(folder / "plain.h5", random_session(3, 10, {}));
  const auto plain = anonymise(open_source(folder / "plain.h5"));
  EXPECT_EQ(plain->report().dropped, (std::vector<std::string>{"uuid"}));
  EXPECT_EQ(plain->report().texts, 0U);
}

}  // namespace
}  // namespace haptrace
