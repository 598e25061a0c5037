// The HTML page of a report, read back by a strict parser instead of a browser.
#include "report/page.h"

#include "tests/report/support.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pugixml.hpp>
#include <set>

namespace haptrace {
namespace {

using test::Reference;
using test::rows_of;
using test::SessionFolder;
using test::TempFolder;
using testing::HasSubstr;
using testing::Not;

/// Parses a page. The test fails if it is not well-formed XML.
pugi::xml_document parsed(const std::string& page) {
  pugi::xml_document document;
  const pugi::xml_parse_result result = document.load_string(page.c_str(), pugi::parse_full);
  EXPECT_TRUE(result) << result.description() << " at " << page.substr(static_cast<std::size_t>(result.offset), 80);
  return document;
}

std::string text_of(const pugi::xml_node& node) {
  std::string text;
  for (const pugi::xpath_node& part : node.select_nodes(".//text()")) text += part.node().value();
  return text;
}

std::string lesson_page(const TempFolder& folder, int repetitions = 8) {
  SessionFolder lesson(folder / "lesson");
  write_lesson(lesson, repetitions);
  return report_page(gather_report(std::vector{lesson.path()}));
}

/// Checks the requirements of every page.
void expect_sound(const std::string& page) {
  const pugi::xml_document document = parsed(page);
  EXPECT_THAT(page, testing::StartsWith("<!DOCTYPE html><html lang=\"en\">"));

  // The page fetches nothing and runs no code.
  EXPECT_TRUE(document.select_nodes("//script | //link | //iframe | //img | //object | //embed | //base").empty());
  EXPECT_TRUE(document.select_nodes("//@src | //@srcset | //@style | //@background | //@action").empty());
  for (const pugi::xpath_node& link : document.select_nodes("//@href"))
    EXPECT_EQ(link.attribute().value()[0], '#') << link.attribute().value();
  for (const pugi::xpath_node& any : document.select_nodes("//@*"))
    EXPECT_NE(std::string_view(any.attribute().name()).substr(0, 2), "on") << any.attribute().name();
  EXPECT_THAT(document.child("html").child("head").child_value("style"), Not(HasSubstr("url(")));
  EXPECT_THAT(document.child("html").child("head").child_value("style"), Not(HasSubstr("@import")));
  EXPECT_THAT(page, HasSubstr("default-src 'none'"));

  // HTML reads <td/> as <td>: only void elements and SVG elements may be self-closing.
  for (const pugi::xpath_node& empty : document.select_nodes("//*[not(node())]")) {
    static const std::set<std::string> kMay{"meta", "line", "path", "circle"};
    if (kMay.contains(empty.node().name())) continue;
    EXPECT_THAT(page, HasSubstr(std::string("</") + empty.node().name() + ">"));
  }

  // Headings are in order, tables have headers, pictures have labels, and the targets of links exist.
  int level = 0;
  for (const pugi::xpath_node& heading : document.select_nodes("//h1 | //h2 | //h3 | //h4")) {
    const int next = heading.node().name()[1] - '0';
    EXPECT_LE(next, level + 1) << text_of(heading.node());
    level = next;
  }
  EXPECT_EQ(document.select_nodes("//h1").size(), 1);
  EXPECT_EQ(document.select_nodes("//main").size(), 1);
  EXPECT_TRUE(document.select_nodes("//th[not(@scope)]").empty());
  EXPECT_TRUE(document.select_nodes("//table[not(caption)]").empty());
  for (const pugi::xpath_node& row : document.select_nodes("//tbody/tr")) {
    const auto columns = row.node().parent().parent().select_nodes("thead/tr/th").size();
    EXPECT_EQ(row.node().select_nodes("td | th").size(), columns);
    EXPECT_EQ(row.node().select_nodes("th[@scope='row']").size(), 1);
  }
  for (const pugi::xpath_node& svg : document.select_nodes("//svg")) {
    EXPECT_STREQ(svg.node().attribute("role").value(), "img");
    EXPECT_STRNE(svg.node().attribute("aria-label").value(), "");
  }
  for (const pugi::xpath_node& link : document.select_nodes("//a"))
    EXPECT_EQ(
        document.select_nodes(fmt::format("//*[@id='{}']", link.node().attribute("href").value() + 1).c_str()).size(),
        1);
  EXPECT_THAT(page, Not(HasSubstr("nan")));
  EXPECT_THAT(page, Not(HasSubstr("inf ")));
}

TEST(ReportPage, IsWellFormedReadableAndFetchesNothing) {
  const TempFolder folder;
  expect_sound(lesson_page(folder));
  for (const Reference reference : {Reference::none, Reference::playback, Reference::guidance}) {
    const std::string file = folder / fmt::format("{}.h5", static_cast<int>(reference));
    test::write(file, rows_of(test::expert_path(), {}, reference), reference);
    expect_sound(report_page(gather_report(std::vector{file})));
  }
  test::write(folder / "empty.h5", {}, Reference::none);
  expect_sound(report_page(gather_report(std::vector{folder / "empty.h5"})));
  expect_sound(report_page(gather_report(std::vector{folder / "empty.h5", folder / "lesson", folder / "1.h5"})));
  expect_sound(report_page({}));
}

TEST(ReportPage, ShowsEveryRepetitionInATableAndInThePicture) {
  const TempFolder folder;
  const pugi::xml_document page = parsed(lesson_page(folder));
  const std::vector<std::size_t> repetitions{3, 2, 8, 3};
  for (std::size_t e = 0; e < repetitions.size(); ++e) {
    const pugi::xml_node section =
        page.select_node(fmt::format("//section[@id='exercise-1-{}']", e + 1).c_str()).node();
    const pugi::xml_node table = section.select_node("div[@class='table short']/table").node();
    EXPECT_EQ(table.select_nodes("tbody/tr").size(), repetitions[e]);
    const pugi::xml_node way = section.select_node(".//figure[1]/svg").node();
    EXPECT_EQ(way.select_nodes("path[contains(@class, 'trial')]").size(), repetitions[e]);
  }
  const pugi::xml_node stopped = page.select_node("//section[@id='exercise-1-3']//tr[@class='stopped']").node();
  EXPECT_THAT(text_of(stopped), testing::AllOf(HasSubstr("\u2013"), HasSubstr("deviation")));
  EXPECT_EQ(page.select_nodes("//section[@id='exercise-1-3']//path[@class='undefined']").size(), 3)
      << "one in each of the trends";
}

TEST(ReportPage, ShowsTheNumbersThatTheLogHas) {
  const TempFolder folder;
  SessionFolder lesson(folder / "lesson");
  const std::size_t exercise = lesson.exercise("one", "tunnel");
  lesson.trial(exercise, {}).figures = {
      {"definitions", 2}, {"contour_rms_m", 0.00123456}, {"sparc", -1.5}, {"time_in_tunnel", 0.876}};
  lesson.save();
  const pugi::xml_document page = parsed(report_page(gather_report(std::vector{lesson.path()})));
  const std::string row = text_of(page.select_node("//section//tbody/tr").node());
  EXPECT_THAT(row, HasSubstr("1.23"));
  EXPECT_THAT(row, HasSubstr("\u22121.50"));
  EXPECT_THAT(row, HasSubstr("88"));
  EXPECT_TRUE(page.select_nodes("//section//th[contains(text(), 'movement time')]").empty())
      << "a metric that is nowhere defined has no column";
}

TEST(ReportPage, MarksRepetitionsThatRanOutOfTimeInEveryTable) {
  const TempFolder folder;
  SessionFolder lesson(folder / "lesson");
  const std::size_t exercise = lesson.exercise("one", "tunnel");
  lesson.trial(exercise, {}).figures = {{"definitions", 2}, {"contour_rms_m", 1e-3}, {"log_jerk", -9}};
  lesson.trial(exercise, {}, "time_over").figures = {
      {"definitions", 2}, {"contour_rms_m", 7.77e-3}, {"log_jerk", -8.88}, {"sparc", -6.66}};
  lesson.trial(exercise, {}, "deviation");
  lesson.save();
  const pugi::xml_document page = parsed(report_page(gather_report(std::vector{lesson.path()})));
  std::string figures;
  const pugi::xpath_node_set tables = page.select_nodes("//section//tbody");
  ASSERT_EQ(tables.size(), 2);
  for (const pugi::xpath_node& table : tables) {
    const pugi::xml_node row = table.node().select_node("tr[2]").node();
    EXPECT_STREQ(row.attribute("class").value(), "stopped");
    EXPECT_THAT(text_of(row), HasSubstr("ran out of time"));
    figures += text_of(row);
  }
  EXPECT_THAT(figures, testing::AllOf(HasSubstr("7.77"), HasSubstr("8.88"), HasSubstr("6.66")))
      << "also a metric that no other repetition has";
  EXPECT_THAT(text_of(page.select_node("//p[@class='lead']").node()),
              HasSubstr("1 ran out of time, 1 was not completed."));
  EXPECT_THAT(text_of(page.select_node("//tbody/tr").node()),
              testing::AllOf(HasSubstr("1 of 3"), Not(HasSubstr("7.77"))));
}

TEST(ReportPage, TreatsUnnamedParticipantsOfTwoSessionsAsDifferent) {
  const TempFolder folder;
  SessionFolder first(folder / "first"), second(folder / "second");
  for (SessionFolder* session : {&first, &second}) {
    session->log.subject = "";
    session->log.created = session == &first ? "2026-03-04T09:00:00Z" : "2026-03-11T09:00:00Z";
    write_lesson(*session, 1);
  }
  const pugi::xml_document page = parsed(report_page(gather_report(std::vector{first.path(), second.path()})));
  EXPECT_THAT(text_of(page.select_node("//p[@class='lead']").node()), testing::StartsWith("18 repetitions were made"));
  EXPECT_EQ(page.select_nodes("//h3[starts-with(text(), 'Without guidance: Circles, first lesson, 04 March')]").size(),
            1);
  EXPECT_EQ(page.select_nodes("//h3[starts-with(text(), 'Without guidance: Circles, first lesson, 11 March')]").size(),
            1);
}

TEST(ReportPage, KeepsHostileTextsInert) {
  const TempFolder folder;
  SessionFolder lesson(folder / "lesson");
  const std::string evil = "</style></title><script>alert(1)</script><img src=x onerror=alert(2)>&amp;\"' ]]>";
  lesson.log.subject = evil;
  lesson.log.notes = "nul, bell and half a character: \x01\x07\xc3";
  lesson.log.programme["title"] = evil;
  lesson.log.programme["description"] = evil;
  const std::size_t exercise = lesson.exercise(evil, "tunnel");
  lesson.trial(exercise, {}).notices = {evil};
  lesson.trial(exercise, {}, "deviation").detail = evil;
  lesson.save();
  const std::string page = report_page(gather_report(std::vector{lesson.path()}));
  expect_sound(page);
  EXPECT_THAT(page, Not(HasSubstr("<script")));
  EXPECT_THAT(page, Not(HasSubstr("<img")));
  EXPECT_EQ(text_of(parsed(page).select_node("//h1").node()), evil) << "it is shown as it was written";

  const std::string file = folder / "evil.h5";
  test::Recorded recorded;
  recorded.header.title = evil + "\xff\xc3";
  recorded.header.subject = evil;
  recorded.header.config = {{"path", evil}, {"mode", evil}};
  recorded.events.push_back({1, 50, "<b onclick=x>"});
  test::write(file, rows_of(test::expert_path(), {}, Reference::playback), Reference::playback, recorded);
  const std::string other = report_page(gather_report(std::vector{file}));
  expect_sound(other);
  EXPECT_THAT(other, Not(HasSubstr("<script")));
  EXPECT_THAT(other, HasSubstr("\uFFFD")) << "bytes that are not valid text";
}

TEST(ReportPage, ShowsASlopeWithItsSignificantDigits) {
  const TempFolder folder;
  SessionFolder lesson(folder / "lesson");
  const std::size_t exercise = lesson.exercise("one", "tunnel");
  for (int i = 0; i < 6; ++i)
    lesson.trial(exercise, {}).figures = {{"definitions", 2},
                                          {"contour_rms_m", 2e-3 - 2e-6 * i + (i % 2 == 0 ? 2e-7 : 0)}};
  lesson.save();
  const std::string page = report_page(gather_report(std::vector{lesson.path()}));
  EXPECT_THAT(page, HasSubstr("falls by 0.0020"));
  EXPECT_THAT(page, Not(HasSubstr("interval 0.00 to")));
}

TEST(ReportPage, StaysSmall) {
  const TempFolder folder;
  const std::string page = lesson_page(folder, 92);
  EXPECT_LT(page.size(), 1'500'000) << "100 repetitions";
  expect_sound(page);
}

TEST(ReportPage, ReportsMissingRecordings) {
  const TempFolder folder;
  SessionFolder lesson(folder / "lesson");
  write_lesson(lesson);
  std::filesystem::remove(lesson.file(lesson.log.trials[5].file));
  lesson.log.complete = false;
  lesson.save();
  const std::string page = report_page(gather_report(std::vector{lesson.path()}));
  expect_sound(page);
  EXPECT_THAT(page, HasSubstr(lesson.log.trials[5].file));
  EXPECT_THAT(page, HasSubstr("recording missing"));
  EXPECT_THAT(page, HasSubstr("The programme was not completed"));
}

}  // namespace
}  // namespace haptrace
