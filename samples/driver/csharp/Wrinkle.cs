// Drives the morph targets of `extras.wrinkle`, without an engine. README.md in the folder above says what is computed, and why.

using System;
using System.Collections;
using System.Collections.Generic;
using System.Globalization;
using System.Linq;

namespace Wrinkles
{
    using Json = Dictionary<string, object>;

    /// <summary>A tip of the player's own that touches: slide and depth, and how far along a row the skin is, scene units.</summary>
    public sealed class Hand
    {
        public double Forward, Sideways, Depth, Along;
    }

    /// <summary>What a driver knows of a frame.</summary>
    public sealed class Frame
    {
        /// <summary>A joint's name to its matrix to world space: 16 numbers, by columns. glTF's axes: x is not mirrored.</summary>
        public Func<string, double[]> JointMatrix;
        /// <summary>The weight of a morph target that no drive sets.</summary>
        public Func<string, double> MorphWeight = name => 0;
        public string Clip = "";
        public double Time;
        /// <summary>Seconds since the last frame. Where it is not a number, nothing lags or swings.</summary>
        public double Elapsed = double.NaN;
        /// <summary>The clips of the file, so that flesh follows a smooth curve through their keys; may be null.</summary>
        public GltfClips Clips;
        /// <summary>While clips blend, the seconds and the shares of those beside `Clip`; 1 is all of the motion.</summary>
        public readonly Dictionary<string, (double time, double share)> Others = new Dictionary<string, (double time, double share)>();
        /// <summary>The matrix to world space of what the file's scene stands below, for `Clips`.</summary>
        public double[] Root = { 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1 };
        /// <summary>By touch, what the player's own tips do.</summary>
        public readonly Dictionary<string, Hand> Hands = new Dictionary<string, Hand>();
    }

    /// <summary>All drives of one node, in the order in which they act.</summary>
    public sealed class Body
    {
        public const int Layout = 3;
        // Of a loop that begins at rest so much of a swing is left when it is shown; and rounds that it plays unseen at most.
        const double Left = 0.001, MostRounds = 100;
        /// <summary>A line for each drive that is left out or does not show.</summary>
        public readonly List<string> Problems = new List<string>();
        readonly List<Drive> drives = new List<Drive>();
        readonly Dictionary<string, double> found = new Dictionary<string, double>();

        /// <param name="wrinkle">A node's `extras.wrinkle`: dictionaries, lists, numbers and strings, as `JsonText` reads them.</param>
        public Body(Json wrinkle, Func<string, bool> hasJoint = null, Func<string, bool> hasTarget = null)
        {
            var layout = Read.Number(wrinkle, "layout", 1);
            if (layout != Layout)
                Problems.Add($"its extras have layout {layout}, and this driver reads {Layout}: bake its source again, or take its version's driver");
            foreach (var kind in layout != Layout ? new string[0] : new[] { "muscles", "flesh", "touches", "tools", "fields", "folds" })
                foreach (var data in Read.List(wrinkle, kind).Cast<Json>())
                {
                    // A fold that no joint bends is driven as a tool.
                    var drive = kind == "flesh" ? new Flesh(data) : kind == "touches" ? new Touch(data) : kind == "fields" ? new Field(data)
                        : kind == "folds" && data.ContainsKey("joint") ? new Fold(data) : (Drive)new Segment(data);
                    var absent = drive.Joints.Where(name => hasJoint != null && !hasJoint(name)).Distinct().ToList();
                    var lost = drive.Targets.Where(name => hasTarget != null && !hasTarget(name)).ToList();
                    if (absent.Count > 0) Problems.Add($"{drive.Name} is left out, as there is no joint {Quoted(absent)}");
                    if (lost.Count > 0) Problems.Add($"{drive.Name} does not show, as there is no morph target {Quoted(lost)}");
                    if (absent.Count == 0) drives.Add(drive);
                }
        }

        /// <summary>How often a clip of so many seconds that loops is to be played unseen, from rest, before it is shown.
        /// Then it begins as it ends, as it does in a bake. 0 without springs.</summary>
        public int UnseenRounds(double seconds)
        {
            var rounds = drives.SelectMany(drive => drive.Springs).Select(spring => Math.Ceiling(-Math.Log(Left) / (spring.Settling * seconds)));
            return (int)Math.Min(rounds.DefaultIfEmpty(0).Max(), MostRounds);
        }

        static string Quoted(IEnumerable<string> names) => string.Join(", ", names.Select(name => $"\"{name}\""));

        /// <summary>The weights of a frame by morph target, in a dictionary that the next call uses again.</summary>
        public Dictionary<string, double> Weights(Frame frame)
        {
            found.Clear();
            Func<string, double> morph = name => found.TryGetValue(name, out var weight) ? weight : frame.MorphWeight(name);
            foreach (var drive in drives)
            {
                // A clip that was baked may have targets of its own, which stand for all.
                var factor = drive.Own.Any(name => morph(name) != 0) ? 0 : drive.StrengthIn(frame.Clip);
                var weights = drive.Split(drive.Weights(frame, morph).Select(weight => factor * weight).ToArray());
                for (var k = 0; k < weights.Length; k++) found[drive.Targets[k]] = weights[k];
            }
            return found;
        }
    }

    static class Read
    {
        public static double Number(object value) => Convert.ToDouble(value, CultureInfo.InvariantCulture);
        public static double Number(Json data, string key, double absent) => data.ContainsKey(key) ? Number(data[key]) : absent;
        public static IEnumerable<object> List(object value) => ((IEnumerable)value).Cast<object>();
        public static IEnumerable<object> List(Json data, string key) => data.ContainsKey(key) ? List(data[key]) : new object[0];
        public static double[] Numbers(object value) => List(value).Select(Number).ToArray();
        public static double[][] Rows(object value) => List(value).Select(Numbers).ToArray();
        public static string[] Names(Json data, string key) => List(data, key).Select(name => (string)name).ToArray();
        /// <summary>By clip, rows of seconds and further numbers.</summary>
        public static Dictionary<string, Rows> Keys(Json data, string key) =>
            data.ContainsKey(key) ? ((Json)data[key]).ToDictionary(each => each.Key, each => Wrinkles.Rows.OfPoints(each.Value))
            : new Dictionary<string, Rows>();
    }

    /// <summary>Rows of numbers, linear between, held before the first and after the last.</summary>
    sealed class Rows
    {
        public readonly double[] Xs;
        public readonly double[][] Ys;
        public Rows(double[] xs, double[][] ys) { Xs = xs; Ys = ys; }
        public Rows(object xs, object ys) : this(Read.Numbers(xs), Read.List(ys).Select(y => y is IEnumerable ? Read.Numbers(y) : new[] { Read.Number(y) }).ToArray()) { }
        public static Rows OfPoints(object points)
        {
            var rows = Read.Rows(points);
            return new Rows(rows.Select(row => row[0]).ToArray(), rows.Select(row => row.Skip(1).ToArray()).ToArray());
        }
        public double[] At(double x)
        {
            if (x < Xs[0]) return (double[])Ys[0].Clone();
            var k = Array.FindIndex(Xs, each => each > x);
            if (k < 0) return (double[])Ys[Ys.Length - 1].Clone();
            var part = (x - Xs[k - 1]) / (Xs[k] - Xs[k - 1]);
            return Ys[k].Select((y, i) => Ys[k - 1][i] + (y - Ys[k - 1][i]) * part).ToArray();
        }
    }

    static class V
    {
        public static double Dot(double[] a, double[] b) { var sum = 0.0; for (var i = 0; i < a.Length; i++) sum += a[i] * b[i]; return sum; }
        public static double[] Minus(double[] a, double[] b) => a.Select((x, i) => x - b[i]).ToArray();
        public static double Length(double[] a) => Math.Sqrt(Dot(a, a));
        public static double Clamp(double x, double low, double high) => Math.Min(Math.Max(x, low), high);
        public static double[] Cross(double[] a, double[] b) =>
            new[] { a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0] };
        /// <summary>The three columns of a 4×4 matrix that turn and scale.</summary>
        public static double[][] Columns(double[] m) => new[] { 0, 4, 8 }.Select(k => new[] { m[k], m[k + 1], m[k + 2] }).ToArray();
        public static double[][] Turn(double[] m) => Columns(m).Select(c => { var size = Length(c); return c.Select(x => x / (size > 0 ? size : 1)).ToArray(); }).ToArray();
        /// <summary>The cube root of the size of the determinant.</summary>
        public static double Scale(double[] m) { var c = Columns(m); return Math.Pow(Math.Abs(Dot(c[0], Cross(c[1], c[2]))), 1.0 / 3); }
        public static double[] Moved(double[] m, double[] p) =>
            new[] { 0, 1, 2 }.Select(i => m[i] * p[0] + m[i + 4] * p[1] + m[i + 8] * p[2] + m[i + 12]).ToArray();
    }

    abstract class Drive
    {
        public readonly string Name;
        public readonly string[] Targets, Own;
        readonly Dictionary<string, double> strengths;
        readonly double strength;
        /// <summary>By weight, the size below 0 at which its further target has weight 1, and 0 without one.</summary>
        protected readonly double[] Lows;
        public abstract IEnumerable<string> Joints { get; }
        public virtual IEnumerable<Spring> Springs => new Spring[0];
        /// <summary>A weight for each target but the further ones of `lows`, without the strength.</summary>
        public abstract double[] Weights(Frame frame, Func<string, double> morph);
        public double StrengthIn(string clip) => strengths.TryGetValue(clip ?? "", out var factor) ? factor : strength;

        /// <summary>Weights below 0 on further targets, for engines that have no such weights.</summary>
        public double[] Split(double[] weights) => Lows == null ? weights
            : weights.Select((weight, k) => Lows[k] > 0 ? Math.Max(weight, 0) : weight)
                .Concat(weights.Select((weight, k) => Math.Max(-weight, 0) / Lows[k]).Where((_, k) => Lows[k] > 0)).ToArray();

        protected Drive(Json data)
        {
            Lows = data.ContainsKey("lows") ? Read.Numbers(data["lows"]) : null;
            Name = data.ContainsKey("name") ? (string)data["name"] : $"the fold of \"{data["joint"]}\"";
            Targets = Read.Names(data, "targets");
            Own = Read.Names(data, "own");
            strength = Read.Number(data, "strength", 1);
            var factors = data.ContainsKey("strengths") ? (Json)data["strengths"] : new Json();
            strengths = factors.ToDictionary(each => each.Key, each => Read.Number(each.Value));
        }
    }

    /// <summary>A point that joints and morph targets carry.</summary>
    sealed class Anchor
    {
        public readonly string[] Joints;
        readonly double[] weights, scales;
        readonly double[][] positions;
        readonly Dictionary<string, double[][]> morphs;

        public Anchor(object value)
        {
            var data = (Json)value;
            Joints = Read.Names(data, "joints");
            (weights, scales, positions) = (Read.Numbers(data["weights"]), Read.Numbers(data["scales"]), Read.Rows(data["positions"]));
            var moves = data.ContainsKey("morphs") ? (Json)data["morphs"] : new Json();
            morphs = moves.ToDictionary(each => each.Key, each => Read.Rows(each.Value));
        }

        /// <summary>Its place in the world, and its joints' scale against rest.</summary>
        public double[] Place(Frame frame, Func<string, double> morph, out double scale)
        {
            var place = new double[3];
            scale = 0;
            for (var k = 0; k < Joints.Length; k++)
            {
                var matrix = frame.JointMatrix(Joints[k]);
                var point = (double[])positions[k].Clone();
                foreach (var each in morphs)
                {
                    var weight = morph(each.Key);
                    for (var i = 0; i < 3; i++) point[i] += weight * each.Value[k][i];
                }
                var moved = V.Moved(matrix, point);
                for (var i = 0; i < 3; i++) place[i] += weights[k] * moved[i];
                scale += weights[k] * V.Scale(matrix) / scales[k];
            }
            return place;
        }
        public double[] Place(Frame frame, Func<string, double> morph) => Place(frame, morph, out _);
    }

    /// <summary>A damped spring.</summary>
    sealed class Spring
    {
        public readonly double Omega, Damping;
        public Spring(object value)
        {
            var data = (Json)value;
            (Omega, Damping) = (2 * Math.PI * Read.Number(data["frequency"]), Read.Number(data["damping"]));
        }

        /// <summary>What is left of a swing fades at least like e to the minus this, times seconds.</summary>
        public double Settling => Omega / (Damping > 1 ? Damping + Math.Sqrt(Damping * Damping - 1) : 1 / Damping);

        static double Expm1(double x) => Math.Abs(x) < 1e-5 ? x + x * x / 2 : Math.Exp(x) - 1;

        /// <summary>What is left of a unit of place, c, and of a unit of speed, s, after so many radians.</summary>
        public void Decay(double turns, out double c, out double s)
        {
            var swing = Math.Sqrt(Math.Abs(1 - Damping * Damping));
            var fading = Math.Exp((Damping > 1 ? swing - Damping : -Damping) * turns);
            var faster = Expm1(-2 * swing * turns);
            if (Damping < 1) (c, s) = (fading * Math.Cos(swing * turns), fading * Math.Sin(swing * turns) / swing);
            else if (Damping > 1) (c, s) = (fading * (1 + faster / 2), -fading * faster / (2 * swing));
            else (c, s) = (fading, turns * fading);
        }

        /// <summary>What is left of a place without speed, so many seconds later.</summary>
        public double Remaining(double seconds)
        {
            Decay(Omega * Math.Max(seconds, 0), out var c, out var s);
            return c + Damping * s;
        }

        /// <summary>Take place and speed per radian on by a frame that draws along a straight line.</summary>
        public void Pass(double[] state, double from, double to, double turns)
        {
            var slope = (to - from) / turns;
            Decay(turns, out var c, out var s);
            var (p, q) = (state[0] - from + 2 * Damping * slope, state[1] - slope);
            state[0] = to - 2 * Damping * slope + c * p + s * (q + Damping * p);
            state[1] = slope + c * q - s * (p + Damping * q);
        }
    }

    /// <summary>Tools and muscles: the length of a segment or path between anchors, against its rest length.</summary>
    sealed class Segment : Drive
    {
        readonly Anchor[] anchors;
        readonly double rest, full, taut, tension;
        readonly string restMorph, tensionMorph;
        readonly Dictionary<string, Rows> restKeys, tensionKeys = new Dictionary<string, Rows>();
        readonly Spring lag;
        readonly Rows table, gains;
        // Of the spring: its place and speed, and the shortening at the last frame.
        double[] state;
        double before;

        public Segment(Json data) : base(data)
        {
            var points = data.ContainsKey("anchors") ? Read.List(data["anchors"]) : new[] { data["origin"], data["target"] };
            anchors = points.Select(point => new Anchor(point)).ToArray();
            rest = Read.Number(data["rest_length"]);
            restKeys = Read.Keys(data, "rest_length_keys");
            if (data.TryGetValue("rest_length_morph", out var follows))
                (restMorph, full) = ((string)((Json)follows)["name"], Read.Number(((Json)follows)["full"]));
            if (data.TryGetValue("tension", out var drawn))
            {
                (tension, tensionKeys) = (Read.Number(((Json)drawn)["length"]), Read.Keys((Json)drawn, "keys"));
                tensionMorph = ((Json)drawn).TryGetValue("morph", out var name) ? (string)name : null;
            }
            if (data.TryGetValue("lag", out var spring)) (lag, taut) = (new Spring(spring), Read.Number(((Json)spring)["taut"]));
            table = new Rows(data["shortenings"], data["weights"]);
            if (data.ContainsKey("gains")) gains = new Rows(data["shortenings"], data["gains"]);
        }

        public override IEnumerable<string> Joints => anchors.SelectMany(each => each.Joints);
        public override IEnumerable<Spring> Springs => lag != null ? new[] { lag } : new Spring[0];

        public override double[] Weights(Frame frame, Func<string, double> morph)
        {
            double scale = 0, distance = 0;
            double[] last = null;
            foreach (var anchor in anchors)
            {
                var place = anchor.Place(frame, morph, out var own);
                if (last != null) distance += V.Length(V.Minus(place, last));
                (last, scale) = (place, scale + own / anchors.Length);
            }
            if (scale < 1e-6)
            {
                if (lag != null) Lagged(-1, frame.Elapsed);
                return new double[Lows?.Length ?? Targets.Length];
            }
            var length = rest;
            if (restMorph != null) length += V.Clamp(morph(restMorph), 0, 1) * (full - rest);
            if (restKeys.TryGetValue(frame.Clip ?? "", out var keys)) length = keys.At(frame.Time)[0];
            var ends = distance / scale;
            var belly = ends - tension * Activation(frame, morph);
            if (lag != null)
            {
                var x = Math.Min(Lagged(taut - belly / length, frame.Elapsed), taut);
                belly = x > 0 ? (taut - x) * length : Math.Max(belly, taut * length);
            }
            // A belly that travels has its place by the ends, whatever activation takes.
            var factor = gains != null ? gains.At(1 - belly / length)[0] : length / rest;
            return table.At(1 - (gains != null ? ends : belly) / length).Select(weight => factor * weight).ToArray();
        }

        /// <summary>An activation shortens a muscle whose ends stay.</summary>
        double Activation(Frame frame, Func<string, double> morph) =>
            tensionMorph != null ? V.Clamp(morph(tensionMorph), 0, 1)
            : tensionKeys.TryGetValue(frame.Clip ?? "", out var keys) ? keys.At(frame.Time)[0] : 0;

        /// <summary>The shortening that tissue follows, which may be below 0; `now` is below 0 where it is stretched.</summary>
        double Lagged(double now, double elapsed)
        {
            var turns = lag.Omega * elapsed;
            if (state == null || double.IsNaN(turns)) (state, before) = (new[] { Math.Max(now, 0), 0 }, now);
            if (turns > 0)
            {
                // Where it begins or ends to be shorter between two frames, the line bends.
                var crosses = before * now < 0;
                var bend = crosses ? before / (before - now) : 1;
                var (from, to) = (Math.Max(before, 0), Math.Max(now, 0));
                var middle = crosses ? 0 : to;
                lag.Pass(state, from, middle, bend * turns);
                if (crosses) lag.Pass(state, middle, to, (1 - bend) * turns);
            }
            before = now;
            return state[0];
        }
    }
}
