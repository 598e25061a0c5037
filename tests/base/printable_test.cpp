#include "base/printable.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace haptrace {
namespace {

TEST(Printable, LeavesTextInEveryLanguageAsItIs) {
  for (const char* text : {"", "plain ~", "Übung für Anaïs", "运动", "\U0001F590", "a\u200db"})
    EXPECT_EQ(printable(text), text);
  EXPECT_EQ(printable_lines("one\n\ttwo\n"), "one\n\ttwo\n");
}

TEST(Printable, WritesOutCharactersThatATerminalObeys) {
  EXPECT_EQ(printable("\x1b[2J\x1b]0;owned\x07"), "\\x1b[2J\\x1b]0;owned\\x07");
  EXPECT_EQ(printable("a\nb\tc\rd\x7f"), "a\\x0ab\\x09c\\x0dd\\x7f");
  EXPECT_EQ(printable_lines("a\rb\x08"), "a\\x0db\\x08");
  EXPECT_EQ(printable("\u009b2J"), "\\u{009b}2J") << "a control sequence of one character";
  EXPECT_EQ(printable("txt\u202egnp"), "txt\\u{202e}gnp") << "characters that reverse the text";
  EXPECT_EQ(printable("\u2028\u2066"), "\\u{2028}\\u{2066}");
  EXPECT_EQ(printable(std::string("\0", 1)), "\\x00");
}

TEST(Printable, WritesOutBytesThatAreNotUtf8) {
  EXPECT_EQ(printable("J\xe4ne"), "J\\xe4ne");
  EXPECT_EQ(printable("\x9b"
                      "2J"),
            "\\x9b2J")
      << "a control sequence for a terminal that does not use UTF-8";
  EXPECT_EQ(printable("\xc3"), "\\xc3");
  EXPECT_EQ(printable("\xc1\x9b\xe0\x80\x9b\xed\xa0\x80"), "\\xc1\\x9b\\xe0\\x80\\x9b\\xed\\xa0\\x80")
      << "overlong or incomplete characters";
}

TEST(Printable, EscapesInJsonAsJsonDoes) {
  const nlohmann::json json{{"text", "a\u009b\u202e\x7f\x1b\nü"}};
  EXPECT_EQ(printable_json(json, -1), "{\"text\":\"a\\u009b\\u202e\\u007f\\u001b\\nü\"}");
  EXPECT_EQ(nlohmann::json::parse(printable_json(json)), json);
  EXPECT_EQ(printable_json({{"text", "J\xe4ne"}}, -1), "{\"text\":\"J\uFFFDne\"}") << "the function does not throw";
}

TEST(InvalidUtf8, IsFoundWhereItBegins) {
  EXPECT_EQ(find_invalid_utf8("Übung"), std::string_view::npos);
  EXPECT_EQ(utf8_text("J\xe4ne, J\u00e4ne\xff"), "J\uFFFDne, J\u00e4ne\uFFFD");
  EXPECT_EQ(utf8_text(""), "");
  EXPECT_EQ(find_invalid_utf8("ab\xff"), 2U);
  EXPECT_EQ(find_invalid_utf8("ü\xc3"), 2U);
}

}  // namespace
}  // namespace haptrace
