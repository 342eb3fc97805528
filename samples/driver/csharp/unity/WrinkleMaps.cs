// Gives the materials of one mesh wrinkle maps and their weights, by property blocks: what WrinkleMaps.hlsl declares.

using System;
using System.Collections.Generic;
using System.Linq;
using System.Text;
using UnityEngine;

namespace Wrinkles
{
    using Json = Dictionary<string, object>;

    public sealed class WrinkleMaps
    {
        /// <summary>Sets of maps that the shader blends, each with one mask.</summary>
        const int Sets = 2;
        readonly List<Shown> shown = new List<Shown>();

        sealed class Shown
        {
            public Renderer renderer;
            public int material;
            public readonly MaterialPropertyBlock block = new MaterialPropertyBlock();
            /// <summary>The names of the weights in the channels of each set's mask.</summary>
            public readonly string[,] weights = new string[Sets, 4];
        }

        /// <summary>By node's name the drives of a maps.json.</summary>
        public static Dictionary<string, Json> Wrinkles(byte[] maps) =>
            Read.List(Parsed(maps), "nodes").Cast<Json>().ToDictionary(each => (string)each["node"], each => (Json)each["wrinkle"]);

        static Json Parsed(byte[] maps) => (Json)JsonText.Parse(Encoding.UTF8.GetString(maps));

        /// <summary>The maps of a node on its renderers; images by their names, without the ending.</summary>
        public WrinkleMaps(byte[] maps, string node, Renderer[] renderers, Texture2D[] images, Action<string> warn)
        {
            foreach (var material in Read.List(Parsed(maps), "materials").Cast<Json>().Where(each => (string)each["node"] == node))
                foreach (var renderer in renderers)
                    for (var k = 0; k < renderer.sharedMaterials.Length; k++)
                        if (renderer.sharedMaterials.Length == 1 || Plain(renderer.sharedMaterials[k].name) == (string)material["name"])
                            shown.Add(Blend(new Shown { renderer = renderer, material = k }, material, images, warn));
            if (shown.Count == 0) warn("there is no material of the maps");
        }

        /// <summary>A name as files of maps have it.</summary>
        static string Plain(string name) =>
            string.Join("_", new string(name.Select(letter => letter < 128 && char.IsLetterOrDigit(letter) ? letter : '_').ToArray())
                .Split(new[] { '_' }, StringSplitOptions.RemoveEmptyEntries));

        static Shown Blend(Shown made, Json material, Texture2D[] images, Action<string> warn)
        {
            var number = 0;
            foreach (var each in Read.List(material, "sets").Cast<Json>())
            {
                number++;
                string mask = null;
                foreach (var weight in Read.List(each, "weights").Cast<Json>())
                {
                    var file = weight.TryGetValue("mask", out var named) ? (string)named : null;
                    if (number > Sets || (mask != null && file != mask))
                    {
                        warn($"{weight["target"]} does not show: the shader blends {Sets} sets with one mask each");
                        continue;
                    }
                    mask = file;
                    var channel = weight.TryGetValue("channel", out var letter) ? "rgba".IndexOf((string)letter, StringComparison.Ordinal) : 0;
                    made.weights[number - 1, channel] = (string)weight["target"];
                }
                if (number > Sets) continue;
                Set(made, "_WrinkleNormal" + number, each, "normal", images, warn);
                Set(made, "_WrinkleOcclusion" + number, each, "ao", images, warn);
                // Without a mask red is 1 everywhere.
                if (mask == null) made.block.SetTexture("_WrinkleMask" + number, Texture2D.whiteTexture);
                else Set(made, "_WrinkleMask" + number, new Json { ["mask"] = mask }, "mask", images, warn);
            }
            return made;
        }

        static void Set(Shown made, string name, Json files, string kind, Texture2D[] images, Action<string> warn)
        {
            if (!files.TryGetValue(kind, out var file)) return;
            var image = images.FirstOrDefault(each => each != null && each.name + ".png" == (string)file);
            if (image == null) warn($"there is no image {file}");
            else made.block.SetTexture(name, image);
        }

        /// <summary>Sets the weights of a frame.</summary>
        public void Show(Dictionary<string, double> weights)
        {
            foreach (var each in shown)
            {
                for (var number = 1; number <= Sets; number++)
                {
                    var found = Enumerable.Range(0, 4).Select(channel => each.weights[number - 1, channel])
                        .Select(name => name != null && weights.TryGetValue(name, out var weight) ? (float)weight : 0).ToArray();
                    each.block.SetVector("_WrinkleWeights" + number, new Vector4(found[0], found[1], found[2], found[3]));
                }
                each.renderer.SetPropertyBlock(each.block, each.material);
            }
        }
    }
}
