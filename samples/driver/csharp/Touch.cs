// Drives of tips that slide the skin.

using System;
using System.Collections.Generic;
using System.Linq;

namespace Wrinkles
{
    using Json = Dictionary<string, object>;

    /// <summary>A tip that slides the skin: keyed by a clip, followed as it comes near, or asked for by the player.</summary>
    sealed class Touch : Drive
    {
        /// <summary>A place of the skin: the only one, or one of a row.</summary>
        sealed class Spot
        {
            public readonly Anchor[] Anchors;
            readonly double[] bend, windows;
            readonly Rows rises;

            public Spot(Json data)
            {
                Anchors = Read.List(data["anchors"]).Select(each => new Anchor(each)).ToArray();
                (bend, windows) = (Read.Numbers(data["bend"]), Read.Numbers(data["windows"]));
                rises = Rows.OfPoints(data["rises"]);
            }

            /// <summary>The weights of its rings at a slide over the greatest.</summary>
            public IEnumerable<double> Rings(double f, double s)
            {
                var length = Math.Sqrt(f * f + s * s);
                var height = length > 0 ? rises.At(length)[0] / length : 0;
                return windows.Select(a => height * Math.Max(f * Math.Cos(a) + s * Math.Sin(a), 0));
            }

            /// <summary>Its middle, and the ways from there forward, sideways and up.</summary>
            public (double[], double[], double[], double[]) Axes(Frame frame, Func<string, double> morph)
            {
                var middle = Anchors[0].Place(frame, morph);
                var ways = Anchors.Skip(1).Select(anchor => V.Minus(anchor.Place(frame, morph), middle)).ToArray();
                return (middle, ways[0], ways[1], ways[2]);
            }

            /// <summary>Where a place of the world is: forward, sideways and above the skin, scene units at rest. Null where the
            /// skin is scaled to nothing.</summary>
            public double[] OnSkin(double[] place, double pad, Frame frame, Func<string, double> morph)
            {
                var (middle, a, b, c) = Axes(frame, morph);
                var way = V.Minus(place, middle);
                var volume = V.Dot(a, V.Cross(b, c)) / pad;
                if (!(Math.Abs(volume) >= 1e-18 * pad * pad)) return null;
                var (f, s, h) = (V.Dot(way, V.Cross(b, c)) / volume, V.Dot(way, V.Cross(c, a)) / volume, V.Dot(way, V.Cross(a, b)) / volume);
                return new[] { f, s, h - bend[0] * f * f - bend[1] * f * s - bend[2] * s * s };
            }
        }

        readonly Spot[] spots;
        readonly Anchor by;
        readonly Anchor[] limb = new Anchor[0];
        readonly double pad, grip, deepest, turn, spacing;
        readonly Spring release;
        readonly Dictionary<string, Rows> keys;
        readonly Dictionary<string, double[]> ends;
        // Of a tip: its place at the last frame, whether it held the skin, the slide when it let go, and seconds since.
        double[] tip, slide = { 0, 0 }, left = { 0, 0 };
        bool held;
        double along, since, time;
        string clip;

        public Touch(Json data) : base(data)
        {
            var row = data.TryGetValue("row", out var further) ? Read.List(further) : new object[0];
            spots = row.Prepend(data).Select(each => new Spot((Json)each)).ToArray();
            spacing = data.TryGetValue("spacing", out var apart) ? Read.Number(apart) : 0;
            by = data.TryGetValue("by", out var point) ? new Anchor(point) : null;
            if (data.TryGetValue("limb", out var points)) limb = Read.List(points).Select(each => new Anchor(each)).ToArray();
            (pad, grip, deepest) = (Read.Number(data["pad"]), Read.Number(data["grip"]), Read.Number(data["deepest"]));
            turn = data.TryGetValue("turn", out var angle) ? Read.Number(angle) : 0;
            (release, keys) = (new Spring(data["release"]), Read.Keys(data, "keys"));
            var moments = data.ContainsKey("ends") ? (Json)data["ends"] : new Json();
            ends = moments.ToDictionary(each => each.Key, each => Read.Numbers(each.Value));
        }

        public override IEnumerable<string> Joints =>
            spots.SelectMany(spot => spot.Anchors).Concat(by == null ? limb : limb.Append(by)).SelectMany(each => each.Joints).Distinct();
        public override IEnumerable<Spring> Springs => by != null ? new[] { release } : new Spring[0];

        public override double[] Weights(Frame frame, Func<string, double> morph)
        {
            var (forward, sideways, depth, at) = Contact(frame, morph);
            var far = Math.Max(Math.Sqrt(forward * forward + sideways * sideways) / grip, 1);
            var (f, s) = (forward / grip / far, sideways / grip / far);
            var (onward, across) = (Math.Cos(turn) * f + Math.Sin(turn) * s, Math.Cos(turn) * s - Math.Sin(turn) * f);
            var ways = new[] { onward, across, -onward, -across }.Select(x => Math.Max(x, 0)).ToArray();
            if (spots.Length > 1)
            {
                var shares = Shares(at);
                return spots.SelectMany((spot, k) => new[] { shares[k] * ways[0], shares[k] * ways[2] }.Concat(spot.Rings(shares[k] * f, shares[k] * s))).ToArray();
            }
            var sine = limb.Length > 0 ? Bend(frame, morph) : 0;
            var sides = limb.Length > 0 ? new[] { Math.Max(sine, 0), Math.Max(-sine, 0) } : new double[0];
            var changes = sides.SelectMany(side => ways.Select(way => side * way));
            return ways.Append(V.Clamp(depth / deepest, 0, 1)).Concat(spots[0].Rings(f, s)).Concat(changes).ToArray();
        }

        /// <summary>The sine of the bend of the limb beyond the joint, towards the skin.</summary>
        double Bend(Frame frame, Func<string, double> morph)
        {
            var axes = spots[0].Axes(frame, morph);
            var (a, b, c) = (axes.Item2, axes.Item3, axes.Item4);
            var volume = V.Dot(a, V.Cross(b, c));
            var way = V.Minus(limb[1].Place(frame, morph), limb[0].Place(frame, morph));
            return volume != 0 ? V.Clamp(V.Dot(way, V.Cross(a, b)) / volume, -1, 1) : 0;
        }

        double Length => spacing * (spots.Length - 1);

        /// <summary>The shares of the places at a distance along the row: those of two neighbours sum to 1.</summary>
        double[] Shares(double at)
        {
            var passed = spots.Length > 1 ? V.Clamp(at, 0, Length) / spacing : 0;
            return spots.Select((_, k) => Math.Max(1 - Math.Abs(passed - k), 0)).ToArray();
        }

        /// <summary>As a place has it; forward is along the row.</summary>
        double[] OnSkin(double[] place, Frame frame, Func<string, double> morph)
        {
            var each = spots.Select(spot => spot.OnSkin(place, pad, frame, morph)).ToArray();
            if (each.Contains(null)) return null;
            var shares = Shares(each.Take(each.Length - 1).Sum(own => V.Clamp(own[0], 0, spacing)));
            return new[] { spacing, 0, 0 }.Select((step, i) => each.Select((own, k) => shares[k] * (own[i] + k * step)).Sum()).ToArray();
        }

        (double, double, double, double) Contact(Frame frame, Func<string, double> morph)
        {
            frame.Hands.TryGetValue(Name, out var hand);
            if (hand == null && keys.TryGetValue(frame.Clip ?? "", out var rows))
            {
                var rest = release.Remaining(frame.Time - rows.Xs[rows.Xs.Length - 1]);
                var at = rows.At(frame.Time).Select(x => rest * x).ToArray();
                return (at[0], at[1], Math.Max(at[2], 0), 0);
            }
            // Where the seconds since the last frame are not known, the skin is at rest.
            if (!(frame.Elapsed >= 0)) (clip, tip, held, slide, left, along, since) = (null, null, false, new double[2], new double[2], 0, 0);
            var now = by != null && hand == null ? OnSkin(by.Place(frame, morph), frame, morph) : null;
            var before = tip ?? now;
            var away = now == null ? 0 : V.Length(new[] { now[0] - V.Clamp(now[0], 0, Length), now[1] });
            var touches = hand != null || (now != null && now[2] < deepest && away < pad + (held ? grip : 0));
            // Within a frame the tip comes or goes where it passes that height.
            var passed = now != null && touches != held && before[2] != now[2] ? (before[2] - deepest) / (before[2] - now[2]) : 0;
            var part = V.Clamp(passed, 0, 1);
            // When that is, a clip that was baked knows better than the heights at both ends of the frame.
            var known = clip == frame.Clip && ends.TryGetValue(clip ?? "", out var moments) ? moments : new double[0];
            var within = known.Where(each => time < each && each <= frame.Time).Select(each => (each - time) / (frame.Time - time));
            var gone = within.DefaultIfEmpty(part).Last();
            var edge = now?.Select((x, i) => before[i] + part * (x - before[i])).ToArray();
            var asked = slide;
            var (from, to) = touches ? (held ? before : edge, now) : (before, edge);
            if (hand != null) asked = new[] { hand.Forward, hand.Sideways };
            else if (now != null && (touches || held)) asked = slide.Select((x, i) => x + to[i] - from[i]).ToArray();
            // Beyond its grip the tip slips.
            var slip = Math.Min(1, grip / Math.Max(V.Length(asked), 1e-30));
            if (touches || held)
            {
                (left, since) = (asked.Select(x => x * slip).ToArray(), tip != null && !touches ? -gone * frame.Elapsed : 0);
                if (hand != null) along = hand.Along;
                else if (now != null) along = (touches ? now : edge)[0] - left[0];
            }
            if (!touches && frame.Elapsed > 0) since += frame.Elapsed;
            var remaining = touches ? 1 : release.Remaining(since);
            var depth = touches ? V.Clamp(hand != null ? hand.Depth : -now[2], 0, deepest) : 0;
            (clip, time) = (frame.Clip, frame.Time);
            (tip, held, slide) = (now, touches, left.Select(x => remaining * x).ToArray());
            return (slide[0], slide[1], depth, along);
        }
    }
}
