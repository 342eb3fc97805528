// The C# driver's answers to `samples/driver/vectors.json`, as JSON on standard output: mono vectors.exe vectors.json
// After the name of a .glb, flesh knows the clips that are in it: mono vectors.exe vectors.json baked.glb
// Of another file it prints the nodes with `extras.wrinkle`, and the names of their tools.

using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using System.Linq;
using Wrinkles;

static class Vectors
{
    static List<object> List(object value) => (List<object>)value;
    static double[] Numbers(object value) => List(value).Select(each => (double)each).ToArray();
    static string Joined(IEnumerable<string> parts) => "[" + string.Join(",", parts) + "]";

    static GltfClips clips;

    static void Main(string[] arguments)
    {
        if (!arguments[0].EndsWith(".json"))
        {
            foreach (var node in GltfExtras.Wrinkles(File.ReadAllBytes(arguments[0])))
                Console.WriteLine(node.Key + ": " + string.Join(", ", List(node.Value["tools"]).Select(tool => ((Dictionary<string, object>)tool)["name"])));
            return;
        }
        clips = arguments.Length > 1 ? new GltfClips(File.ReadAllBytes(arguments[1])) : null;
        var cases = (Dictionary<string, object>)JsonText.Parse(File.ReadAllText(arguments[0]));
        Console.WriteLine("{" + string.Join(",", cases.Select(each => Quoted(each.Key) + ":" + Case(each.Value))) + "}");
    }

    static string Quoted(string text) => "\"" + text.Replace("\"", "\\\"") + "\"";

    static string Case(object value)
    {
        var found = (Dictionary<string, object>)value;
        var wrinkle = (Dictionary<string, object>)found["wrinkle"];
        var later = new Dictionary<string, object>(wrinkle) { ["layout"] = Body.Layout + 1.0 };
        var problems = new Body(wrinkle, name => name != (string)List(found["joints"])[0],
            name => name != (string)List(found["targets"])[0]).Problems.Concat(new Body(later).Problems);
        var unseen = List(found["runs"]).Select(run => new Body(wrinkle).UnseenRounds((double)((Dictionary<string, object>)run)["seconds"]).ToString());
        return $"{{\"runs\":{Joined(Runs(found))},\"unseen\":{Joined(unseen)},\"problems\":{Joined(problems.Select(Quoted))}}}";
    }

    static IEnumerable<string> Runs(Dictionary<string, object> found)
    {
        var joints = List(found["joints"]);
        var morphs = List(found["morphs"]);
        foreach (Dictionary<string, object> run in List(found["runs"]))
        {
            var body = new Body((Dictionary<string, object>)found["wrinkle"]);
            var times = Numbers(run["times"]);
            var elapsed = List(run["elapsed"]).Select(each => (double?)each ?? double.NaN).ToArray();
            var matrices = List(run["matrices"]).Select(row => List(row).Select(Numbers).ToArray()).ToArray();
            var rows = List(run["morphs"]).Select(Numbers).ToArray();
            var frames = elapsed.Select((seconds, number) =>
            {
                var k = number % times.Length;
                var frame = new Frame { Clip = (string)run["clip"], Time = times[k], Elapsed = seconds, Clips = clips };
                if (run.TryGetValue("hands", out var hands) && List(hands)[k] != null)
                {
                    var hand = Numbers(List(hands)[k]);
                    var touch = (Dictionary<string, object>)List(((Dictionary<string, object>)found["wrinkle"])["touches"])[0];
                    frame.Hands[(string)touch["name"]] = new Hand { Forward = hand[0], Sideways = hand[1], Depth = hand[2] };
                }
                if (run.TryGetValue("others", out var others))
                    foreach (var other in (Dictionary<string, object>)List(others)[k])
                    {
                        var playing = (Dictionary<string, object>)other.Value;
                        frame.Others[other.Key] = ((double)playing["time"], (double)playing["share"]);
                    }
                frame.JointMatrix = name => matrices[k][joints.IndexOf(name)];
                frame.MorphWeight = name => morphs.Contains(name) ? rows[k][morphs.IndexOf(name)] : 0;
                var weights = body.Weights(frame);
                var texts = List(found["targets"]).Select(name => weights[(string)name].ToString("R", CultureInfo.InvariantCulture));
                return Joined(texts);
            });
            yield return Joined(frames);
        }
    }
}
