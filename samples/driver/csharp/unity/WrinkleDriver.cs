// Sets blend shapes of baked characters in Unity, or the weights of wrinkle maps, by the driver in the folder above.
//
// Put this folder and those files into Assets, and the component on the root of an imported character. `gltf` is the baked
// file itself, copied with the ending .bytes, as importers do not keep extras; bake it with `--engine unity`. For maps,
// `maps` is maps.json and `images` has the images beside it; the character is then the asset as it was.

using System;
using System.Collections.Generic;
using System.Linq;
using UnityEngine;

namespace Wrinkles
{
    public sealed class WrinkleDriver : MonoBehaviour
    {
        public TextAsset gltf;
        public TextAsset maps;
        public Texture2D[] images = new Texture2D[0];
        /// <summary>The clip that plays and its seconds; found by the Animator or Animation of this object if it has one.</summary>
        public string clip = "";
        public float time;
        /// <summary>Slides and dents of touches by the player's own tips, by name.</summary>
        public readonly Dictionary<string, Hand> hands = new Dictionary<string, Hand>();
        readonly List<Driven> bodies = new List<Driven>();
        GltfClips clips;
        // Of a clip that is played unseen.
        const float FramesPerSecond = 60;

        sealed class Driven
        {
            public Body body;
            public SkinnedMeshRenderer[] renderers;
            public Dictionary<string, Transform> joints;
            public WrinkleMaps maps;
        }

        void Start()
        {
            clips = gltf == null ? null : new GltfClips(gltf.bytes);
            var places = GetComponentsInChildren<Transform>(true);
            foreach (var each in maps == null ? GltfExtras.Wrinkles(gltf.bytes) : WrinkleMaps.Wrinkles(maps.bytes))
            {
                var parts = each.Value.TryGetValue("parts", out var others) ? ((List<object>)others).Cast<string>() : new string[0];
                var renderers = parts.Prepend(each.Key).SelectMany(name => places.Where(place => place.name == name))
                    .SelectMany(place => place.GetComponentsInChildren<SkinnedMeshRenderer>(true)).Distinct().ToArray();
                // Joints of the body's own skin go first, as characters often share names.
                var joints = new Dictionary<string, Transform>();
                var order = renderers.SelectMany(renderer => renderer.bones).Concat(places).Where(joint => joint != null).ToArray();
                // Where joints share a name, extras have a path in its place.
                Func<string, bool> isThere = name => (joints[name] = order.FirstOrDefault(joint => joint.name == name)
                    ?? order.FirstOrDefault(joint => Path(joint).EndsWith("/" + name))) != null;
                Func<string, bool> isShape = name => renderers.Any(renderer => Shape(renderer, name) >= 0);
                var body = new Body(each.Value, isThere, maps == null ? isShape : null);
                Action<string> warn = line => Debug.LogWarning($"wrinkle: {each.Key}: {line}", this);
                body.Problems.ForEach(warn);
                if (renderers.Length == 0) Debug.LogWarning($"wrinkle: there is no mesh below \"{each.Key}\"", this);
                else bodies.Add(new Driven { body = body, renderers = renderers, joints = joints,
                    maps = maps == null ? null : new WrinkleMaps(maps.bytes, each.Key, renderers, images, warn) });
            }
            if (bodies.Count == 0) Debug.LogWarning("wrinkle: nothing to drive: no node has extras.wrinkle", this);
        }

        static string Path(Transform place) => place == null ? "" : Path(place.parent) + "/" + place.name;

        static int Shape(SkinnedMeshRenderer renderer, string name) => renderer.sharedMesh.GetBlendShapeIndex(name);

        /// <summary>Importers store the full weight of a shape as 1 or as 100.</summary>
        static float Full(SkinnedMeshRenderer renderer, int shape) => renderer.sharedMesh.GetBlendShapeFrameWeight(shape, 0);

        /// <summary>Unity's x points to the other side than glTF's: importers turn the axes of every node.</summary>
        static double[] Matrix(Transform joint)
        {
            var m = joint.localToWorldMatrix;
            return new double[] { m.m00, -m.m10, -m.m20, 0, -m.m01, m.m11, m.m21, 0, -m.m02, m.m12, m.m22, 0, -m.m03, m.m13, m.m23, 1 };
        }

        /// <summary>After animation, before rendering.</summary>
        void LateUpdate()
        {
            FindClip();
            Drive(Time.deltaTime);
        }

        /// <summary>Brings springs to the beginning of a clip that loops, which begins as it ends: plays it unseen as often as
        /// they need. Call it when the loop starts, with what poses this object at a time of the clip, such as
        /// `seconds => clip.SampleAnimation(gameObject, seconds)`.</summary>
        public void Settle(string name, float length, Action<float> pose)
        {
            var rounds = bodies.Select(each => each.body.UnseenRounds(length)).DefaultIfEmpty(0).Max();
            var frames = Math.Max((int)Math.Ceiling(FramesPerSecond * length), 1);
            for (var frame = 0; frame <= rounds * frames; frame++)
            {
                (clip, time) = (name, frame % frames * length / frames);
                pose(time);
                Drive(frame > 0 ? length / frames : double.NaN); // at first all is at rest
            }
        }

        void Drive(double elapsed)
        {
            foreach (var each in bodies)
            {
                var first = each.renderers[0];
                var frame = new Frame { Clip = clip, Time = time, Elapsed = elapsed, Clips = clips, Root = Matrix(transform) };
                foreach (var hand in hands) frame.Hands[hand.Key] = hand.Value;
                frame.JointMatrix = name => Matrix(each.joints[name]);
                frame.MorphWeight = name =>
                {
                    var shape = Shape(first, name);
                    return shape < 0 ? 0 : first.GetBlendShapeWeight(shape) / Full(first, shape);
                };
                var weights = each.body.Weights(frame);
                if (each.maps != null) each.maps.Show(weights);
                else foreach (var weight in weights)
                    foreach (var renderer in each.renderers)
                    {
                        var shape = Shape(renderer, weight.Key);
                        if (shape >= 0) renderer.SetBlendShapeWeight(shape, (float)weight.Value * Full(renderer, shape));
                    }
            }
        }

        void FindClip()
        {
            var animator = GetComponent<Animator>();
            var legacy = GetComponent<Animation>();
            if (animator != null && animator.runtimeAnimatorController != null)
            {
                var playing = animator.GetCurrentAnimatorClipInfo(0).OrderByDescending(info => info.weight).ToArray();
                if (playing.Length == 0) return;
                var passed = animator.GetCurrentAnimatorStateInfo(0).normalizedTime;
                clip = playing[0].clip.name;
                time = (playing[0].clip.isLooping ? passed - Mathf.Floor(passed) : Mathf.Min(passed, 1)) * playing[0].clip.length;
            }
            else if (legacy != null)
            {
                var state = legacy.Cast<AnimationState>().Where(each => each.enabled).OrderByDescending(each => each.weight).FirstOrDefault();
                if (state != null) (clip, time) = (state.name, state.time % Mathf.Max(state.length, 1e-6f));
            }
        }
    }
}
