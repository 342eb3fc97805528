// A reader of JSON, for engines that bring none: dictionaries, lists, numbers, strings, booleans and null.

using System;
using System.Collections.Generic;
using System.Globalization;
using System.Text;

namespace Wrinkles
{
    public sealed class JsonText
    {
        readonly string text;
        int at;
        JsonText(string text) { this.text = text; }

        /// <summary>The value that a text has; FormatException if it is not JSON.</summary>
        public static object Parse(string text)
        {
            var reader = new JsonText(text);
            var value = reader.Value();
            if (reader.Next() != '\0') throw reader.Wrong();
            return value;
        }

        FormatException Wrong() => new FormatException($"not JSON at character {at}");

        char Next()
        {
            while (at < text.Length && char.IsWhiteSpace(text[at])) at++;
            return at < text.Length ? text[at] : '\0';
        }

        void Expect(char wanted)
        {
            if (Next() != wanted) throw Wrong();
            at++;
        }

        object Value()
        {
            switch (Next())
            {
                case '{': return Members();
                case '[': return Elements();
                case '"': return Text();
                case 't': return Word("true", true);
                case 'f': return Word("false", false);
                case 'n': return Word("null", null);
                default: return Number();
            }
        }

        object Word(string word, object value)
        {
            if (string.CompareOrdinal(text, at, word, 0, word.Length) != 0) throw Wrong();
            at += word.Length;
            return value;
        }

        Dictionary<string, object> Members()
        {
            var found = new Dictionary<string, object>();
            for (Expect('{'); Next() != '}';)
            {
                if (found.Count > 0) Expect(',');
                Next();
                var name = Text();
                Expect(':');
                found[name] = Value();
            }
            at++;
            return found;
        }

        List<object> Elements()
        {
            var found = new List<object>();
            for (Expect('['); Next() != ']';)
            {
                if (found.Count > 0) Expect(',');
                found.Add(Value());
            }
            at++;
            return found;
        }

        object Number()
        {
            var start = at;
            while (at < text.Length && "+-.eE0123456789".IndexOf(text[at]) >= 0) at++;
            var digits = text.Substring(start, at - start);
            if (!double.TryParse(digits, NumberStyles.Float, CultureInfo.InvariantCulture, out var number)) throw Wrong();
            return number;
        }

        string Text()
        {
            Expect('"');
            var found = new StringBuilder();
            for (; ; at++)
            {
                if (at >= text.Length) throw Wrong();
                var c = text[at];
                if (c == '"') break;
                if (c == '\\')
                {
                    if (++at >= text.Length) throw Wrong();
                    var escape = "bfnrt\"\\/".IndexOf(text[at]);
                    if (escape >= 0) c = "\b\f\n\r\t\"\\/"[escape];
                    else
                    {
                        if (text[at] != 'u' || at + 4 >= text.Length) throw Wrong();
                        c = (char)Convert.ToInt32(text.Substring(at + 1, 4), 16);
                        at += 4;
                    }
                }
                found.Append(c);
            }
            at++;
            return found.ToString();
        }
    }
}
